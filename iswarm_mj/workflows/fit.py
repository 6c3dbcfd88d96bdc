"""Fits of measured voltages: what is printed, fit.toml, result.json and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj._version import __version__
from iswarm_mj.gripper.fitting.estimate import Interval
from iswarm_mj.gripper.fitting.fit import Fit, Prediction, Proposal
from iswarm_mj.gripper.fitting.text import (
    parameter_lines,
    place_text,
    prediction_lines,
    range_text,
    residual_lines,
    sentences,
)
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    CONTACT_GAP,
    PROBE_RADIUS,
    RELEASE_GAP,
)
from iswarm_mj.output.results import write_result
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import atomic_write
from iswarm_mj.workflows.grasp import run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings, settings_of

SETTINGS_FILE = "fit.toml"
"""File that `iswarm grasp --config` and `iswarm clean --config` take."""
_SHARED = (
    "work_tool_object",
    "work_object_substrate",
    "spread_tool_object",
    "spread_object_substrate",
    "humidity_doubling",
    "humidity_fall",
)
"""Parameters that the bench and the swarm have as settings."""
_OF_SWARMS = {
    "electrical_gap": CONTACT_GAP,
    "probe_radius": PROBE_RADIUS,
    "tip_curvature": np.inf,
    "ball_density": BALL_DENSITY,
    "tool.roughness": 0.0,
    "plate.roughness": 0.0,
}
"""Settings of the bench by name, and what they are in swarms, which cannot set them. SI units."""
_BREAKDOWN_FIELD = 1e9
"""Field at which the tool's oxide breaks down, by default [V/m]."""


@dataclass(frozen=True)
class Places:
    """Where voltages are predicted. SI units."""

    radii: Sequence[float] = ()
    """Radii of the balls; by default the median of the table's [m]."""
    humidities: Sequence[float] = ()
    """Relative humidities; by default those of the table, at most five [%]."""
    gaps: Sequence[float] = (RELEASE_GAP,)
    """Gaps to the plate of releases [m]."""


def run_fit(fitted: Fit, places: Places, n_trials: int, out: Path, source: str) -> None:
    """Write fit.toml, result.json and figures of a fit, and print its tables and sentences.

    Args:
        fitted: the fit.
        places: where voltages are predicted.
        n_trials: number of trials on the bench at each place, 0 for none.
        out: directory of the files.
        source: what the fit was made from, for the files.
    """
    require("paper")
    from iswarm_mj.output.plot_fit import draw_data, draw_profiles

    # Before the directory is made, since places may be refused.
    predictions = predict(fitted, places)
    statements = sentences(fitted)
    trials = []
    if n_trials:
        trials = predict_by_trials(fitted, predictions, n_trials)

    with locked(out):
        with atomic_write(out / SETTINGS_FILE) as part:
            part.write_text(settings_text(fitted, source), encoding="utf-8")
        write_result(out, result_of(fitted, predictions, statements, trials, source))
        draw_data(fitted, out / "fit_data")
        draw_profiles(fitted, out / "fit_profiles")

    n_rows = len(fitted.measurements)
    blocks = [
        [f"{n_rows} rows of {source}"],
        parameter_lines(fitted),
        residual_lines(fitted),
        prediction_lines(predictions),
        [trial_text(entry) for entry in trials],
        statements,
        swarm_warnings(fitted),
        [f"settings {out / SETTINGS_FILE}, figures {out / 'fit_data.png'}, fit_profiles.png"],
    ]
    print("\n\n".join("\n".join(block) for block in blocks if block))


def predict(fitted: Fit, places: Places) -> list[Prediction]:
    """Return the grasp and release voltages at all places."""
    rows = fitted.measurements
    radii = places.radii or [np.quantile(rows.radius, 0.5, method="nearest").item()]
    humidities = places.humidities or np.unique(rows.humidity)[:5].tolist()
    predictions = []
    for radius, humidity in product(radii, humidities):
        predictions.append(fitted.predict("grasp", radius, humidity))
        for gap in places.gaps:
            predictions.append(fitted.predict("release", radius, humidity, gap))
    return predictions


def grasp_settings(fitted: Fit) -> dict[str, Any]:
    """Return the settings of `iswarm grasp` that a fit determines or holds, by name."""
    values = fitted.values
    settings: dict[str, Any] = {name: values[name] for name in (*_SHARED, "electrical_gap")}
    first = fitted.measurements.chosen(slice(0, 1))
    if first.probe_radius[0] != PROBE_RADIUS:
        settings["probe_radius"] = first.probe_radius[0].item()
    if np.isfinite(first.tip_curvature[0]):
        settings["tip_curvature"] = first.tip_curvature[0].item()
    settings["ball_density"] = first.ball_density[0].item()
    for surface in ("tool", "plate"):
        if values[f"{surface}_roughness"]:
            settings[f"{surface}.roughness"] = values[f"{surface}_roughness"]
    if "breakdown_voltage" in fitted.model.free:
        settings["contacts.oxide"] = values["breakdown_voltage"] / _BREAKDOWN_FIELD
    return settings


def swarm_warnings(fitted: Fit) -> list[str]:
    """Return why works of the fit mean other voltages in a swarm, in one sentence or none."""
    settings = grasp_settings(fitted)
    differences = [
        f"{name} {settings[name]:.4g} (swarms: {of_swarms:g})"
        for name, of_swarms in _OF_SWARMS.items()
        if name in settings and settings[name] != of_swarms
    ]
    if not differences:
        return []
    return [
        f"Warning: [gripper] holds works of a fit with {', '.join(differences)}; swarms that take "
        "them need other voltages than your table."
    ]


def settings_text(fitted: Fit, source: str) -> str:
    """Return fit.toml: tables for the bench and for swarms, with what is not determined."""
    lines = [
        f"# From iswarm fit {source}.",
        "# `iswarm grasp --config` reads [grasp]; commands on swarms read [gripper]; iswarm play both.",
        "# Values are in SI units: works in J/m^2, lengths in m, humidities in %, densities in kg/m^3.",
        "",
        "[grasp]",
        *_assignments(fitted, grasp_settings(fitted)),
        "",
        *(f"# {warning}" for warning in swarm_warnings(fitted)),
        "[gripper]",
        *_assignments(fitted, {name: fitted.values[name] for name in _SHARED}),
    ]
    return "\n".join(lines) + "\n"


def _assignments(fitted: Fit, settings: Mapping[str, Any]) -> list[str]:
    """Return settings as lines of TOML, with a comment on those that are not determined.

    Comments grade estimates and state intervals as the printed table does.
    """
    lines = []
    for name, value in settings.items():
        comment = ""
        if name in fitted.model.free and not fitted.estimates[name].is_determined:
            estimate = fitted.estimates[name]
            parameter = fitted.model.parameters[name]
            grade = "determined roughly" if estimate.is_informed else "not determined"
            interval = range_text(estimate.interval, parameter.scale, parameter.unit)
            comment = f"  # {grade}: {interval}"
        elif name in fitted.model.parameters and name not in fitted.model.free:
            comment = "  # held"
        lines.append(f"{name} = {value:.6g}{comment}")
    return lines


def result_of(
    fitted: Fit,
    predictions: Sequence[Prediction],
    statements: Sequence[str],
    trials: Sequence[Mapping[str, Any]],
    source: str,
) -> dict[str, Any]:
    """Return the content of result.json, in SI."""
    parameters = {}
    for name, parameter in fitted.model.parameters.items():
        if parameter.is_linear:
            continue
        entry: dict[str, Any] = {"value": fitted.values[name], "is_estimated": False}
        if name in fitted.model.free:
            estimate = fitted.estimates[name]
            entry |= _interval_entry(estimate.interval)
            entry |= {
                "is_estimated": True,
                "is_informed": estimate.is_informed,
                "is_determined": estimate.is_determined,
                "prior": {"median": parameter.median, "factor": parameter.factor},
            }
        parameters[name] = entry

    # Directions of the parameters' space by how much the table says of them.
    free = fitted.model.free
    information = np.linalg.inv(fitted.maximum.covariance) - np.eye(len(free))
    eigenvalues, vectors = np.linalg.eigh(information)
    directions = [
        {"information": value, **dict(zip(free, vector, strict=True))}
        for value, vector in zip(eigenvalues.tolist(), vectors.T.tolist(), strict=True)
    ]
    return {
        "version": __version__,
        "fit": {
            "source": source,
            "rows": len(fitted.measurements),
            "parameters": parameters,
            "difference_of_works": {
                **_interval_entry(fitted.difference.interval),
                "is_determined": fitted.difference.is_determined,
            },
            "directions": directions,
            "shape_tests": [test._asdict() for test in fitted.shape_tests],
            "residuals": [None if np.isnan(z) else z.item() for z in fitted.residuals],
            "predictions": [_prediction_entry(prediction) for prediction in predictions],
            "trials": list(trials),
            "proposal": _proposal_entry(fitted.proposal),
            "statements": list(statements),
        },
    }


def _interval_entry(interval: Interval) -> dict[str, float | None]:
    """Return an interval for JSON; None where it has no end."""
    return {
        name: float(value) if np.isfinite(value) else None
        for name, value in interval._asdict().items()
    }


def _prediction_entry(prediction: Prediction) -> dict[str, Any]:
    """Return a prediction for JSON."""
    return {**prediction._asdict(), "median": _interval_entry(prediction.median)}


def _proposal_entry(proposal: Proposal | None) -> dict[str, Any] | None:
    """Return a proposal for JSON."""
    if proposal is None:
        return None
    return {
        **_prediction_entry(proposal.prediction),
        "target": proposal.target,
        "before": _interval_entry(proposal.before),
        "after": _interval_entry(proposal.after),
    }


def predict_by_trials(
    fitted: Fit, predictions: Sequence[Prediction], n_trials: int
) -> list[dict[str, Any]]:
    """Return voltages by trials of the bench with the estimated parameters.

    Args:
        fitted: the fit.
        predictions: grasps and releases to repeat as trials.
        n_trials: number of trials at each radius and humidity.

    Returns:
        An entry for each radius, humidity, experiment and gap: number of trials and of those with a
        voltage, and the median of the voltages [V].
    """
    entries = []
    for radius, humidity in dict.fromkeys((entry.radius, entry.humidity) for entry in predictions):
        gaps = dict.fromkeys(entry.gap for entry in predictions if entry.kind == "release")
        rows = run_grasp(trial_settings(fitted, radius, humidity, tuple(gaps), n_trials))
        for kind, gap in [("grasp", 0.0), *(("release", gap) for gap in gaps)]:
            chosen = [row.voltage for row in rows if row.experiment == kind and row.gap == gap]
            voltages = [voltage for voltage in chosen if voltage is not None]
            entries.append(
                {
                    "kind": kind,
                    "radius": radius,
                    "humidity": humidity,
                    "gap": gap,
                    "trials": len(chosen),
                    "with_voltage": len(voltages),
                    "median": float(np.median(voltages)) if voltages else None,
                }
            )
    return entries


def trial_settings(
    fitted: Fit, radius: float, humidity: float, gaps: tuple[float, ...], n_trials: int
) -> GraspSettings:
    """Return the settings of trials on the bench with the estimated parameters.

    Args:
        fitted: the fit.
        radius: of the balls [m].
        humidity: relative humidity [%].
        gaps: gaps to the plate of releases [m].
        n_trials: number of trials.
    """
    values = grasp_settings(fitted)
    values |= {
        "radius": [f"{radius:.10g}"],
        "rh": [humidity],
        "repeats": n_trials,
        "rh_spread": 0.0,
        "gap": list(gaps),
    }
    # Rounded tips have no attempts without contact, and no setting for them.
    if "tip_curvature" not in values:
        values["no_contact_gap"] = []
    return settings_of(values, source="the fit")


def trial_text(entry: Mapping[str, Any]) -> str:
    """Return the line of an entry of `predict_by_trials`."""
    interval = Interval(0.0, 0.0, 0.0)
    place = Prediction(
        entry["kind"], entry["radius"], entry["humidity"], entry["gap"], interval, 0.0, 0.0
    )
    median = "none" if entry["median"] is None else f"median {entry['median']:.1f} V"
    return (
        f"trials of the bench, {entry['kind']}, {place_text(place)}: {median}, "
        f"{entry['with_voltage']} of {entry['trials']} with a voltage"
    )
