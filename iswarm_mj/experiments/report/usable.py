"""Tables that a report can use: those from which findings and a command follow."""

from dataclasses import replace

from iswarm_mj.experiments.analysis import evolution_findings, grasp_findings
from iswarm_mj.experiments.report.reproduction import command
from iswarm_mj.experiments.report.results import Result, Results
from iswarm_mj.experiments.studies.registry import EXPERIMENTS


def usable(results: Results) -> Results:
    """Results without the tables that are read but hold something else than their names and settings say."""
    odd = [result for result in results.used if not _is_usable(result, results)]
    return replace(
        results,
        experiments={name: result for name, result in results.experiments.items() if result not in odd},
        searches={method: result for method, result in results.searches.items() if result not in odd},
        trials=None if results.trials in odd else results.trials,
        unusable=results.unusable + [result.path for result in odd],
    )


def _is_usable(result: Result, results: Results) -> bool:
    try:
        if result is results.trials:
            grasp_findings.findings(result.rows)
        elif result in results.searches.values():
            evolution_findings.findings({result.settings["method"]: (result.rows, result.settings)})
        else:
            EXPERIMENTS[result.settings["experiment"]].findings(result.rows)
        command(result)
    except Exception:  # columns may lack, or hold anything
        return False
    return True
