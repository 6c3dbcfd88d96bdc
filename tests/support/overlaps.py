"""Overlaps of rectangles by their corners, apart from the package's own geometry. Units: mm, rad."""

import numpy as np


def corners_of(pose, half_edges):
    """Return the corners (4, 2) of a rectangle at x, y and yaw."""
    x, y, yaw = pose
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    rotation = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    return (x, y) + (signs * half_edges) @ rotation


def gap(first, second, first_half_edges, second_half_edges):
    """Return the largest gap of two rectangles along normals of their sides (SAT).

    It is negative where they overlap.
    """
    first_corners = corners_of(first, first_half_edges)
    second_corners = corners_of(second, second_half_edges)
    gaps = []
    for yaw in (first[2], second[2]):
        for angle in (yaw, yaw + np.pi / 2):
            axis = np.array([np.cos(angle), np.sin(angle)])
            first_places = first_corners @ axis
            second_places = second_corners @ axis
            gaps.append(second_places.min() - first_places.max())
            gaps.append(first_places.min() - second_places.max())
    return max(gaps)
