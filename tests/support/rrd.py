"""Reads Rerun recordings back."""

from rerun.chunk import RrdReader


def read(path):
    """Return all columns of a recording: entity -> column -> values in the order of steps.

    An entity that has no steps has one value for each column.
    """
    rows_of_entity = {}
    for chunk in RrdReader(path).stream().to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            rows_of_entity.setdefault(chunk.entity_path, []).append(row)

    columns = {}
    for entity, rows in rows_of_entity.items():
        rows_of_steps = [row for row in rows if "step" in row]
        rows_of_steps.sort(key=lambda row: row["step"])
        if rows_of_steps:
            names = list(rows_of_steps[0])
            columns[entity] = {name: [row[name] for row in rows_of_steps] for name in names}
        else:
            columns[entity] = {name: value for row in rows for name, value in row.items()}
    return columns
