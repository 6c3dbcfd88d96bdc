"""What a time was measured on."""

import os
import platform
from pathlib import Path
from typing import Any


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def hardware() -> dict[str, Any]:
    """Processor, and how many of its cores may be used."""
    return {"cores": len(os.sched_getaffinity(0)), "machine": processor()}
