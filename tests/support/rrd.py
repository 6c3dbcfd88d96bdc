"""Recordings, read back."""

from rerun.chunk import RrdReader


def read(path):
    """All columns of a recording: entity -> column -> list with one entry a row, in the order of
    steps."""
    rows = {}
    for chunk in RrdReader(path).stream().to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            rows.setdefault(chunk.entity_path, []).append(row)
    columns = {}
    for entity, group in rows.items():
        moving = sorted((row for row in group if "step" in row), key=lambda row: row["step"])
        still = {name: value for row in group for name, value in row.items()}
        columns[entity] = (
            {name: [row[name] for row in moving] for name in moving[0]} if moving else still
        )
    return columns
