"""The paper's experiments: their runs, the statements on them, and the report."""
