"""Values that are no settings."""

ODD_VALUES = [
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, float("nan"), float("inf"), 10**30, "", "x", "ä\n|<b>", [], [[]],
    [1], {}, {"a": 1}, "9" * 5000, 2**31, -(2**63), "\x1b[31m",
]  # fmt: skip
