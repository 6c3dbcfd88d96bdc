"""What every room may use: arrays, units, errors, files, tables."""
