"""The names that the documentation states are those of recordings."""

import re
import sys
from pathlib import Path

import numpy as np
from helpers_rrd import read
from helpers_swarm_recording import make_frames, make_scene, write

from iswarm_mj.output.trajectory import AREA, METRIC

sys.path.append(str(Path(__file__).parents[2] / "tools"))
from make_tables import NAMES


def of_a_task(scene, frames):
    """The same with a metric, an area and a recorded number of the task's and the strategy's own."""
    scene = scene._replace(
        memory_names=(*scene.memory_names, "wait"),
        memory_units=(*scene.memory_units, ""),
        memory_sizes=(*scene.memory_sizes, 1),
        metric_names=("share",),
        metric_units=("",),
        metric_descriptions=("",),
        area_names=("spot",),
        area_colours=((9, 9, 9),),
        area_shapes=("square",),
    )
    shape = frames.pose.shape[:2]
    frames.memory["wait"] = np.zeros(shape)
    frames.task.update({AREA + "spot": np.ones((shape[0], 1, 3)), METRIC + "share": np.ones(shape[0])})
    return scene, frames


def general(name):
    name = re.sub(r"robot_\d+$", "robot_N", name)
    return re.sub(r"(?<=[/_])(dust|dump|wait|share|spot)$|^(dust|dump)(?=_)", "NAME", name)


def test_every_name_is_stated_and_exists(tmp_path):
    scene = make_scene(12, 4)
    scene, frames = of_a_task(scene, make_frames(scene, 12))
    write(tmp_path / "a.rrd", scene, frames)
    found = set()
    for entity, columns in read(tmp_path / "a.rrd").items():
        if "step" in columns:
            names = columns.keys() - {"step", "sim_time", "rerun.controls.RowId"}
            found |= {(general(entity.removeprefix("/")), general(name)) for name in names}
    stated = {(entity, component) for entity, component, *_ in NAMES}
    assert found == stated - {("world/robots/body", "said_NAME")}  # the paper's messages are vectors and the priority
    assert len(stated) == len(NAMES)
