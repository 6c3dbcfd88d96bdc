"""A fit in words: tables of estimates and predictions, and what the data do not determine."""

import math

import numpy as np

from iswarm_mj.gripper.fitting.estimate import Interval
from iswarm_mj.gripper.fitting.fit import SIGNIFICANCE, Estimate, Fit, Prediction
from iswarm_mj.gripper.fitting.table import FORCES
from iswarm_mj.utils.tables import aligned

_HELPS = 0.9
"""Ratio of the widths after and before, below which a proposed measurement helps."""
_UM = 1e-6
_NN = 1e-9
_NOUNS = {
    "grasp": "grasp voltage",
    "release": "release voltage",
    "no_contact": "voltage that lifts without contact",
    "pull_off_tool": "pull-off force from the tool",
    "pull_off_plate": "pull-off force from the plate",
    "melting": "voltage that melts a ball",
}
"""What is measured, by kind."""


def number(value: float) -> str:
    """Return a number with three digits, or "not found" for nan."""
    if math.isnan(value):
        return "not found"
    if not math.isfinite(value) or value == 0:
        return f"{value:g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(digits, 6)}f}"


def interval_text(interval: Interval, scale: float, unit: str) -> str:
    """Return an estimate with its interval in a unit, as "16.4 mJ/m^2 (13.5 to 19.4)"."""
    value, low, high = (number(end / scale) for end in interval)
    return f"{value}{f' {unit}' if unit else ''} ({low} to {high})"


def range_text(interval: Interval, scale: float, unit: str) -> str:
    """Return an interval without its estimate, as "0.20 to 19.3 mJ/m^2"."""
    return f"{number(interval.low / scale)} to {number(interval.high / scale)} {unit}".strip()


def parameter_lines(fitted: Fit) -> list[str]:
    """Return the lines of the table of estimates."""
    lines = [("parameter", "estimate", "95 % interval", "unit", "determined", "prior")]
    for name, estimate in fitted.estimates.items():
        parameter = fitted.model.parameters[name]
        interval = estimate.interval
        lines.append(
            (
                f"{parameter.text} {parameter.symbol}",
                number(interval.value / parameter.scale),
                range_text(interval, parameter.scale, ""),
                parameter.unit,
                _grade(estimate),
                parameter.prior_text,
            )
        )
    interval = fitted.difference.interval
    lines.append(
        (
            "their difference W_plate - W_tool",
            number(interval.value / 1e-3),
            range_text(interval, 1e-3, ""),
            "mJ/m^2",
            _grade(fitted.difference),
            "",
        )
    )
    return aligned(lines)


def _grade(estimate: Estimate) -> str:
    """Return whether an estimate is determined, in one word."""
    if estimate.is_determined:
        return "yes"
    return "roughly" if estimate.is_informed else "no"


def place_text(prediction: Prediction) -> str:
    """Return where a prediction holds, as "20 um, 10 % RH, gap 5 um"."""
    gap = ""
    if prediction.kind in ("release", "no_contact"):
        gap = f", gap {prediction.gap / _UM:g} um"
    return f"{prediction.radius / _UM:g} um, {prediction.humidity:g} % RH{gap}"


def prediction_lines(predictions: list[Prediction]) -> list[str]:
    """Return the lines of the table of predictions."""
    lines = [("prediction", "median", "95 % interval", "95 % of balls", "unit")]
    for prediction in predictions:
        scale, unit = unit_of(prediction.kind)
        balls = f"{number(prediction.balls_low / scale)} to {number(prediction.balls_high / scale)}"
        lines.append(
            (
                f"{prediction.kind.replace('_', ' ')}, {place_text(prediction)}",
                number(prediction.median.value / scale),
                range_text(prediction.median, scale, ""),
                balls,
                unit,
            )
        )
    return aligned(lines)


def unit_of(kind: str) -> tuple[float, str]:
    """Return the unit of a kind in SI, and its name."""
    return (_NN, "nN") if kind in FORCES else (1.0, "V")


def sentences(fitted: Fit) -> list[str]:
    """Return what the table determines, what it does not, and what would help, in plain words."""
    return [
        _on_works(fitted),
        *_on_spreads(fitted),
        *_on_gap(fitted),
        _on_held(fitted),
        *_on_shape(fitted),
        _on_proposal(fitted),
    ]


def _on_works(fitted: Fit) -> str:
    """Return which works of adhesion the table determines."""
    tool = fitted.estimates.get("work_tool_object")
    plate = fitted.estimates.get("work_object_substrate")
    if tool is None or plate is None:
        return "A work of adhesion was held; the other one depends on that value."
    if tool.is_determined and plate.is_determined:
        return "Both works of adhesion are determined."
    difference = interval_text(fitted.difference.interval, 1e-3, "mJ/m^2")
    rows = fitted.measurements
    kinds_with_values = rows.kind[(rows.low > 0) & np.isfinite(rows.high)]
    has_grasps_alone = set(kinds_with_values.tolist()) - {"melting"} == {"grasp"}
    if fitted.difference.is_determined and has_grasps_alone:
        return (
            f"Only W_plate - W_tool is determined, {difference}: grasp voltages depend on nothing "
            "else of the two works, and do not predict a release."
        )
    if not (tool.is_informed or plate.is_informed):
        return "No work of adhesion is determined; their intervals are mostly those of the priors."
    return f"{_knowledge('W_tool', tool)}; {_knowledge('W_plate', plate)}."


def _knowledge(symbol: str, estimate: Estimate) -> str:
    """Return how well a work of adhesion is known, as a clause."""
    if estimate.is_determined:
        return f"{symbol} is determined"
    if estimate.is_informed:
        return f"{symbol} is known roughly, {range_text(estimate.interval, 1e-3, 'mJ/m^2')}"
    return f"{symbol} is not determined, and keeps its prior"


def _on_spreads(fitted: Fit) -> list[str]:
    """Return which spreads rest on their priors."""
    vague = [
        fitted.model.parameters[name].symbol
        for name, estimate in fitted.estimates.items()
        if name.startswith("spread") and not estimate.is_determined
    ]
    if not vague:
        return []
    verb = "is" if len(vague) == 1 else "are"
    return [
        f"{' and '.join(vague)} {verb} not determined within a factor of 2; more balls would help."
    ]


def _on_gap(fitted: Fit) -> list[str]:
    """Return that the electrical gap is held at the least one of the laws, where it is."""
    if not fitted.is_gap_bounded:
        return []
    least = 1e6 * fitted.values["electrical_gap"]
    return [
        f"The table asks for an electrical gap below {least:.3g} um, the least one of the laws, at "
        "which it is held: works of adhesion are too large, or voltages too low."
    ]


def _on_held(fitted: Fit) -> str:
    """Return which parameters were not estimated, and what follows."""
    humidity = fitted.measurements.humidity
    has_effect = {
        "electrical_gap": bool((fitted.measurements.kind == "grasp").any()),
        "humidity_doubling": bool((humidity > 10).any()),
        "humidity_fall": bool((humidity < 10).any()),
    }
    texts = []
    for name, is_used in has_effect.items():
        if is_used and name not in fitted.model.free:
            parameter = fitted.model.parameters[name]
            unit = f" {parameter.unit}".rstrip()
            value = number(parameter.usual / parameter.scale)
            texts.append(f"{parameter.text} {parameter.symbol} = {value}{unit}")
    if not texts:
        return "No parameter was held."
    consequence = ""
    if has_effect["electrical_gap"] and "electrical_gap" not in fitted.model.free:
        consequence = "; works from grasps change as 1 / D_eff"
    return f"Held: {', '.join(texts)}{consequence}."


def _on_shape(fitted: Fit) -> list[str]:
    """Return whether the data agree with the law's dependence on radius and humidity."""
    texts = []
    for test in fitted.shape_tests:
        p_value = f"p = {test.p_value:.2g}"
        if test.p_value < SIGNIFICANCE:
            symbol = "R" if test.variable == "radius" else "h(RH)"
            texts.append(
                f"The {test.variable} dependence of your data is not in the law: {p_value}; "
                f"adhesion would need a further factor {symbol}^{test.exponent:.2g}."
            )
        else:
            texts.append(f"The {test.variable} dependence agrees with the law: {p_value}.")
    return texts


def _on_proposal(fitted: Fit) -> str:
    """Return which measurement would help most."""
    proposal = fitted.proposal
    if proposal is None:
        return "No measurement is proposed: balls would move without a voltage, or melt."
    parameter = fitted.model.parameters[proposal.target]
    width_before = _width(proposal.before)
    width_after = _width(proposal.after)
    if not (math.isfinite(width_before) and math.isfinite(width_after)):
        return f"The interval of {parameter.symbol} was not found, nor what would narrow it."
    if width_after >= _HELPS * width_before:
        return "No further measurement of one ball would narrow an interval by a tenth."
    now = range_text(proposal.before, parameter.scale, parameter.unit)
    then = range_text(proposal.after, parameter.scale, parameter.unit)
    scale, unit = unit_of(proposal.prediction.kind)
    expected = number(proposal.prediction.median.value / scale)
    separates = ""
    works_are_separate = all(
        fitted.estimates[name].is_informed
        for name in ("work_tool_object", "work_object_substrate")
        if name in fitted.estimates
    )
    if proposal.prediction.kind == "release" and not works_are_separate:
        separates = ", and separate the two works"
    return (
        f"One {_NOUNS[proposal.prediction.kind]} ({place_text(proposal.prediction)}) would help "
        f"most{separates}: if it is {expected} {unit}, {parameter.symbol} is known to {then} "
        f"instead of {now}."
    )


def _width(interval: Interval) -> float:
    """Return the width of an interval of a positive parameter, in logarithms."""
    return math.log(interval.high / interval.low)


def residual_lines(fitted: Fit) -> list[str]:
    """Return mean residuals by radius and by humidity."""
    rows = fitted.measurements
    lines = [("residuals", "rows", "mean [standard deviations]")]
    is_known = ~np.isnan(fitted.residuals)
    for variable, scale, unit in (("radius", _UM, "um"), ("humidity", 1.0, "% RH")):
        values = getattr(rows, variable)
        for value in np.unique(values[is_known])[:10]:
            chosen = is_known & (values == value)
            mean = float(np.mean(fitted.residuals[chosen]))
            lines.append((f"{value / scale:g} {unit}", str(int(chosen.sum())), f"{mean:+.2f}"))
    return aligned(lines)
