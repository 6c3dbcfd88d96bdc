"""`iswarm play`."""

import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, ClassVar

from iswarm_mj.commands.command_settings import refuse_changed
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.swarm import WithTask
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.progress import waiting
from iswarm_mj.utils.signals import saved
from iswarm_mj.workflows.grasp_settings import GraspSettings


@dataclass(frozen=True)
class Play(WithTask):
    """Show a swarm in the browser while it runs, and change its rules, noise, robots and balls."""

    MAIN: ClassVar = (
        "task_name",
        "controller",
        "robots",
        "genome",
        "seed",
        "engine",
        "port",
        "changes",
        "fits",
        "out",
    )

    worlds: Annotated[int, Within(1, 1)] = 1
    """The page shows one world."""
    port: Annotated[int, Within(1024, 64_535)] = 8080
    """Port of the page, on this machine alone; the next free one if it is taken."""
    open: bool = True
    """Open the page in the browser, where there is one."""
    changes: tuple[str, ...] = ()
    """Changes after a number of control steps: STEP:SETTING=VALUE, STEP:kill=ROBOT,
    STEP:revive=ROBOT, STEP:ball=X,Y [rd], STEP:fail=SHARE or STEP:move=ROBOT,X,Y [rd]."""
    fits: tuple[Path, ...] = ()
    """Files with settings of the gripper's bench, such as the fit.toml of `iswarm fit`; the tab
    Gripper begins with the first one. By default that of `--config`, if it has a table [grasp]."""
    out: Path = Path("runs/play")
    """Directory for recordings that are made on the page."""

    def session(self) -> Any:
        """Return the run at its start, as a `Session`."""
        described = self.scenario()
        refuse_changed(self, ["engine.chunk"], "on the page, which shows every step")
        from iswarm_mj.player.changes import Change
        from iswarm_mj.player.scenario import PageScenario
        from iswarm_mj.player.session import Session

        scenario = PageScenario.of(described)
        with waiting("placing the robots"):
            return Session(scenario, [Change.parse(text) for text in self.changes], self.out)

    def calibrations(self) -> dict[str, Any]:
        """Return settings of the bench, `BenchSettings`, by the names of their files.

        Those of the paper come last.

        Raises:
            UserError: a file cannot be read, or has what the page cannot show.
        """
        from iswarm_mj.player.bench import CALIBRATIONS
        from iswarm_mj.player.bench_settings import BenchSettings

        of_files = {}
        for path in self.fits:
            settings = read_grasp(path)
            try:
                of_files[str(path)] = BenchSettings.of(settings)
            except UserError as error:
                raise UserError(f"--fits {path}: {error}") from None
        return of_files | CALIBRATIONS

    def run(self) -> None:
        """Run the command."""
        require("play")
        calibrations = self.calibrations()
        session = self.session()
        from iswarm_mj.player.page import Page

        page = Page(session, self.port, calibrations)
        session.is_playing = True
        print(f"{page.url} shows the swarm, on this machine alone; Ctrl-C ends it.", flush=True)
        print("Whoever has this address can use the page.", flush=True)
        with ExitStack() as files:
            if self.open:
                file = files.enter_context(redirect_file(page.url))
                webbrowser.open(file.as_uri())
            page.wait()


def read_grasp(path: Path) -> GraspSettings:
    """Return the settings of `iswarm grasp` in a file, by the rules of its `--config`.

    Raises:
        UserError: it cannot be read, or has other settings.
    """
    from iswarm_mj.commands.parser import parse

    try:
        return parse("grasp", Grasp, ["--config", str(path)])
    except UserError as error:
        raise UserError(str(error).replace("--config", "--fits")) from None


@contextmanager
def redirect_file(url: str) -> Iterator[Path]:
    """Keep a file that leads a browser to an address, until the end of the block.

    All users of the machine can read the command line of the browser. It therefore gets the name of
    this file, which only its user can read, and not the address.
    """
    text = f"""<!doctype html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={url}">
<title>iswarm play</title>
<a href="{url}">Open the page</a>
"""
    directory = TemporaryDirectory(prefix="iswarm-")  # of mode 0700
    with saved(directory.cleanup):  # also where a signal ends the process while C code runs
        file = Path(directory.name, "play.html")
        file.touch(0o600)
        file.write_text(text, encoding="utf-8")
        yield file
