"""The panel beside the swarm: buttons, controls of settings, plots, and the memory of a robot."""

import math
import time
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.geometry.obstacles import Obstacle, distances, numbers
from iswarm_mj.output.legend import LINKS, TRAILS
from iswarm_mj.output.shapes import MILLIMETRES
from iswarm_mj.player import scene
from iswarm_mj.player.bench import Bench
from iswarm_mj.player.bench_settings import BenchSettings
from iswarm_mj.player.changes import BALL, FAIL, KILL, MOVE, REVIVE
from iswarm_mj.player.controls import Control
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.inspection import describe_robot
from iswarm_mj.player.next_start import Misfit
from iswarm_mj.player.plots import Plots
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Activity, Session
from iswarm_mj.player.settings_tabs import SettingsTabs
from iswarm_mj.player.sweeps import SweepFolder
from iswarm_mj.player.view import SwarmView
from iswarm_mj.player.widgets import copyable, save, show, spots
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

SELECT = "select a robot"
DROP = "drop a ball"
LIFE = "kill or revive a robot"
REMOVE = "remove a robot (at the next reset)"
BUILD = "put or take away an obstacle (at the next reset)"
CLICK_EFFECTS = (SELECT, DROP, LIFE, REMOVE, BUILD)
"""Effects of a click on the arena."""
SWARM = "the swarm"
GRIPPER = "the gripper's bench"
"""Contents of the scene."""
THEME = {"show_logo": False, "show_share_button": False}
"""Settings of viser's page."""
FASTEST = 60
"""Largest number of control steps a second."""
_SHORT_S = 0.7
"""Duration up to which what a session does is not worth a line [s]."""
_BENCH_SIZE = 1 / 6
"""Size of the gripper's bench in edges of the arena, which the scene shows in its place."""
_OBSTACLE_HALF_EDGE = 1.0
"""Half the edge of an obstacle that a click puts [rd]."""


_FOLLOW = "The camera moves along with it."
_ROBOT = (
    "Click on a robot: here it shows what it knows, hears and says. "
    "Drag a robot to put it elsewhere."
)
_DRAWN = {
    LINKS: "Lines from each robot to the one that it hears.",
    TRAILS: "The latest way of each robot that is loaded.",
}
_ARROWS = "Arrows to the place that each robot remembers."
"""Explanations of what can be drawn."""


class _ButtonLook(NamedTuple):
    """Look of the button that starts and stops the run."""

    label: str
    icon: str
    """Name of an icon of viser."""
    colour: str


_PLAY = _ButtonLook("Play", "player-play", "green")
_PAUSE = _ButtonLook("Pause", "player-pause", "orange")


class Panel:
    """Controls of a session; each is the same in all browsers.

    Three kinds of threads meet here:

    - The thread of the session (`Session.work`) alone changes the run and its scenario. Whatever an
      input does to them is therefore posted (`Session.post`).
    - viser's event loop calls the actions of inputs, and threads of its pool call `clicked`. They
      post, or set at once what no control step reads: `speed`, `click`, what is drawn, the theme.
      `clicked` takes the session's lock, since it reads robots and the view together.
    - The drawing thread (`Page._tick`) calls `rebuild` after each reset, `update` a few times a
      second, and `synchronise` after errors. It holds the session's lock, so that no reset comes
      in between; control steps do.

    Attributes:
        view: nodes of the swarm.
        follows: all cameras move along with the selected robot.
        content: input that chooses what the scene shows, `SWARM` or `GRIPPER`.
        bench: bench of the gripper.
        speed: control steps a second that are wanted.
        click: effect of a click on the arena, one of `CLICK_EFFECTS`.
    """

    def __init__(
        self,
        server: Any,
        session: Session,
        calibrations: Mapping[str, BenchSettings],
    ):
        """Draw the swarm, and make the controls.

        Args:
            server: viser server of the page.
            session: session on which the controls act.
            calibrations: settings of the bench that can be chosen, by their names.
        """
        gui = server.gui
        self._gui = gui
        self._session = session
        self._inputs = Inputs(server, refused=session.messages.put, failed=session.fail)
        self.view = SwarmView(server.scene, session.scene)
        self.click = SELECT
        self._ways_to_colour = (scene.STATE,)
        self._add_run_controls()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Watch"):
            self._add_watch_tab()
        rules = tabs.add_tab("Rules")
        with rules:
            gui.add_markdown("These settings change at once.")
            with gui.add_folder("Sweep one setting", expand_by_default=False):
                self.sweeps = SweepFolder(gui, self._inputs, session)
        world = tabs.add_tab("World")
        with world:
            gui.add_markdown("These wait for **Reset**.")
        self._settings = SettingsTabs(gui, self._inputs, session, rules, world)
        self._shown_scenarios = (session.next_start, session.now)
        self._shown_parts = _names_of_parts(session.wanted)
        self._pending: dict[str, str] = {}
        self._has_removed_robot = False
        self._shown_misfit: Misfit | None = None
        with tabs.add_tab("Robot"):
            self.follows = False
            follow = Control("follow the selected robot", "", False, text=_FOLLOW)
            self._inputs.add(follow, lambda value: setattr(self, "follows", value))
            self._robot = gui.add_markdown(_ROBOT)
        with tabs.add_tab("Gripper"):
            size = session.scene.arena_size * MILLIMETRES * _BENCH_SIZE
            self.bench = Bench(server, self._inputs, size, calibrations)
        with tabs.add_tab("Share"):
            self._add_share_tab()

    def _add_run_controls(self) -> None:
        """Add the controls above the tabs."""
        session = self._session
        inputs = self._inputs
        self.content = inputs.add(_choice("show", (SWARM, GRIPPER)))

        def toggle() -> None:
            session.is_playing = not session.is_playing

        def step() -> None:
            session.is_playing = False
            session.advance()

        self._play = inputs.add_button(
            _PLAY.label,
            lambda _: session.post(toggle),
            icon=_PLAY.icon,
            color=_PLAY.colour,
        )
        actions = {"Step": step, "Reset": session.reset}
        buttons = _choice("run", tuple(actions))
        inputs.add_buttons(buttons, lambda name: session.post(actions[name]))

        speed = Control("speed", "", 10, limits=Within(1, FASTEST, "steps/s"))
        self.speed = float(speed.value)
        inputs.add(speed, lambda value: setattr(self, "speed", float(value)))
        self._status = self._gui.add_markdown("")

        # Only strategies and tasks of users' files can be read again.
        self._file_controls = (
            inputs.add_button("Reload code", lambda _: session.post(session.reload), icon="reload"),
            inputs.add(
                Control("reload by itself", "", False, text="Begin again when a file changes."),
                lambda value: setattr(session, "reloads_by_itself", value),
            ),
        )

    def _add_watch_tab(self) -> None:
        """Add the choices of what is drawn, the legend, and the plots."""
        gui = self._gui
        inputs = self._inputs

        def colour_by(way: str) -> None:
            self.view.colour_by = way

        def set_click(effect: str) -> None:
            self.click = effect

        def set_dark(is_dark: bool) -> None:
            gui.configure_theme(dark_mode=is_dark, **THEME)

        self._colour = inputs.add(_choice("colour by", (scene.STATE,)), colour_by)
        self._draw_folder = gui.add_folder("Draw")
        self._draws: dict[str, Any] = {}
        self._legend = gui.add_html("")
        inputs.add(_choice("a click can", CLICK_EFFECTS), set_click)
        with gui.add_folder("Failures", expand_by_default=False):
            share = Control(
                "share that fails", "", 0.1, limits=Within(0, 1), text="Share of the living robots."
            )
            self._failing_share = inputs.add(share)
            inputs.add_button("Let them fail now", lambda _: self._let_fail(), icon="heart-broken")
        self._plots = Plots(gui, inputs, self._session)
        inputs.add(Control("dark page", "", False), set_dark)

    def _add_share_tab(self) -> None:
        """Add the command, the file and the recording."""
        gui = self._gui
        session = self._session
        self._repeats = gui.add_markdown("")
        self._command = gui.add_html("")

        def download(client: Any) -> None:
            save(client, "play.toml", session.toml().encode())

        self._inputs.add_button("Save as TOML", download, icon="download")

        def record(is_wanted: bool) -> None:
            try:
                if is_wanted:
                    session.start_recording()
                else:
                    session.stop_recording()
            finally:
                self._show_recording()

        self._is_recorded = self._inputs.add(
            Control("record for Rerun", "", False),
            lambda value: session.post(lambda: record(value), control="record"),
        )
        self._recording = gui.add_markdown("")
        self._shown_recording = (False, session.recording)

    def _show_recording(self) -> None:
        """Show whether the run is recorded, and the name of the latest file."""
        session = self._session
        self._shown_recording = (session.is_recording, session.recording)
        is_recording, path = self._shown_recording
        show(self._is_recorded, "value", is_recording)
        if is_recording:
            show(self._recording, "content", f"Recording to `{path}`.")
        elif path is not None:
            show(self._recording, "content", f"Recorded `{path}`; open it with `rerun`.")

    def rebuild(self) -> None:
        """Show the controls, the ways to colour and the plots of a run that begins."""
        session = self._session
        view = self.view
        self._inputs.clear_notes()
        self._shown_misfit = None
        self._settings.rebuild()
        self._settings.synchronise()
        snapshot = session.snapshots[-1]
        ways = scene.ways_to_colour(session.scene, snapshot.frames, snapshot.energy)
        self._ways_to_colour = tuple(ways)
        self._inputs.offer(self._colour, self._ways_to_colour)
        view.colour_by = self._colour.value
        self._offer_to_draw(view.drawable)
        self._plots.rebuild()
        self.sweeps.rebuild()

    def _offer_to_draw(self, names: tuple[str, ...]) -> None:
        """Show a box to tick for each kind of lines and arrows that can be drawn."""
        if tuple(self._draws) == names:
            return
        for handle in self._draws.values():
            self._inputs.forget(handle)
            handle.remove()
        self._draws = {}
        with self._draw_folder:
            for name in names:
                label = name if name in _DRAWN else f"remembered {name}"
                text = _DRAWN.get(name, _ARROWS)
                control = Control(label, "", name in self.view.shows, text=text)
                self._draws[name] = self._inputs.add(control, partial(self._draw, name))

    def _draw(self, name: str, is_drawn: bool) -> None:
        """Draw lines or arrows from now on, or no longer."""
        self.view.draw(name, is_drawn=is_drawn)

    def synchronise(self) -> None:
        """Show the values of the present settings, also where an input shows a refused one."""
        self._settings.synchronise()

    def clicked(self, x: float, y: float, radius: float) -> None:
        """Act on a click on the floor.

        Args:
            x: place [mm].
            y: place [mm].
            radius: largest distance of a robot that is meant [mm].

        Raises:
            UserError: too many clicks wait.
        """
        session = self._session
        with session.lock:  # no reset comes between the robots and the view
            robot = self._robot_near(x, y, radius)
            if self.click == SELECT:
                self.view.selected = robot

        if self.click == DROP:
            session.post(lambda: session.change(BALL, f"{x / RD:.3f},{y / RD:.3f}"))
        elif self.click == BUILD:
            session.post(lambda: self._build(x / RD, y / RD))
        elif self.click == LIFE and robot is not None:
            session.post(lambda: self._kill_or_revive(robot))
        elif self.click == REMOVE and robot is not None:
            session.post(self._remove_robot)

    def dragged(self, robot: int, x: float, y: float) -> None:
        """Put a robot elsewhere.

        Args:
            robot: number of the robot.
            x: place [mm].
            y: place [mm].

        Raises:
            UserError: too many clicks wait.
        """
        session = self._session
        session.post(lambda: session.change(MOVE, f"{robot},{x / RD:.3f},{y / RD:.3f}"))

    def _robot_near(self, x: float, y: float, radius: float) -> int | None:
        """Return the robot that is nearest to a place [mm]; None if it is farther than a radius."""
        positions = self._session.snapshots[-1].frames.pose[0, :, :2] * 1e3
        distance_to_click = np.linalg.norm(positions - np.array([x, y]), axis=-1)
        robot = int(distance_to_click.argmin())
        return robot if distance_to_click[robot] <= radius else None

    def _build(self, x: float, y: float) -> None:
        """Let the next reset put an obstacle at a place [rd], or take away those that cover it."""
        session = self._session
        obstacles = _with_obstacle_at(session.wanted.config.arena, x, y)
        session.want("arena.obstacles", obstacles)

    def _let_fail(self) -> None:
        """Let a share of the robots fail, which then only stand in the way."""
        share = self._failing_share.value
        session = self._session
        session.post(lambda: session.change(FAIL, f"{share:g}"))

    def _kill_or_revive(self, robot: int) -> None:
        """Kill a robot, or revive it if it is dead."""
        session = self._session
        # A reset since the click may have left fewer robots: `change` refuses the number then.
        exists = robot < len(session.is_alive)
        is_dead = exists and not session.is_alive[robot]
        session.change(REVIVE if is_dead else KILL, str(robot))

    def _remove_robot(self) -> None:
        """Let the next reset begin with one robot fewer.

        It makes no difference which robot was clicked: a reset places all of them anew.
        """
        session = self._session
        session.want("robots", max(1, session.wanted.n_robots - 1))
        self._has_removed_robot = True  # `update` shows the new number

    def update(self) -> None:
        """Show the state of the session; a few times a second."""
        session = self._session
        if self._inputs.show_notes() or self._has_removed_robot:
            self._has_removed_robot = False
            self.synchronise()
        self._show_settings()
        for handle in self._file_controls:
            show(handle, "visible", session.has_files)
        self._show_play_button()
        show(self._status, "content", self._describe_run())
        self._show_legend()
        self._show_command()
        # The session completes a recording by itself at a reset, and when areas move.
        if self._shown_recording != (session.is_recording, session.recording):
            self._show_recording()
        self._show_robot()
        self._plots.update()
        self.sweeps.update()

    def _show_play_button(self) -> None:
        """Let the button say what a click on it does."""
        look = _PAUSE if self._session.is_playing else _PLAY
        if self._play.label != look.label:
            self._play.label = look.label
            self._play.icon = look.icon
            self._play.color = look.colour

    def _show_legend(self) -> None:
        """Show what the colours mean."""
        session = self._session
        view = self.view
        if view.colour_by not in self._ways_to_colour:  # chosen while another task came
            view.colour_by = self._ways_to_colour[0]
            show(self._colour, "value", view.colour_by)
        legend = scene.legend(session.scene, view.colour_by, view.shows, session.is_alive)
        show(self._legend, "content", spots(legend))

    def _show_robot(self) -> None:
        """Show what the selected robot knows, hears and says, if there is one."""
        session = self._session
        selected = self.view.selected
        if selected is None:
            return
        snapshot = session.snapshots[-1]
        memory = snapshot.record.swarm.memory
        text = describe_robot(session.scene, snapshot.frames, memory, selected)
        show(self._robot, "content", text)

    def _show_settings(self) -> None:
        """Show inputs for the present settings, and which changes wait for a reset.

        Changed obstacles that wait are drawn as shadows. Nothing is done if neither what waits
        (`next_start`) nor the scenario of the run (`now`) has changed.
        """
        next_start = self._session.next_start
        now = self._session.now
        shown_next_start, shown_now = self._shown_scenarios
        if next_start is shown_next_start and now is shown_now:
            return
        self._shown_scenarios = (next_start, now)
        wanted = next_start.wanted

        # Add and remove inputs. Their values are set only where another strategy, task or engine
        # brings its own: otherwise the inputs already show what the browser sent. The session may
        # lag behind, and a slider would jump back while the user moves it.
        self._settings.rebuild()
        parts = _names_of_parts(wanted)
        if parts != self._shown_parts:
            self._shown_parts = parts
            self._settings.synchronise()

        self._show_misfit()
        self._pending = self._session.pending
        obstacles_wait = "obstacles" in self._pending
        self.view.draw_planned(wanted.config.arena.obstacles if obstacles_wait else ())

    def _show_misfit(self) -> None:
        """Say beneath a task, strategy or engine why it does not fit yet, or no longer say so."""
        misfit = self._session.misfit
        if misfit == self._shown_misfit:
            return
        self._shown_misfit = misfit
        if misfit is None:
            self._inputs.clear_notes()
        else:
            self._settings.note(*misfit)

    def _describe_run(self) -> str:
        """Return what the run is and what it waits for, in Markdown."""
        session = self._session
        now = session.now
        n_robots = session.run.settings.n_robots
        parts = f"{now.task_label}, {now.strategy_label}"
        lines = [f"**step {session.step}** · {n_robots} robots · {parts}"]
        is_rate_known = math.isfinite(session.rate)
        if is_rate_known:
            lines[0] += f" · up to {session.rate:.0f} steps/s"
        lines += describe_activity(session.activity)
        if session.run.is_over:
            lines.append("Nothing is left to do.")
        if session.changed_files:
            listed = ", ".join(session.changed_files)
            lines.append(f"**{listed}** changed on disk: **Reset** reads it again.")
        if session.file_error:
            lines.append(f"**Error:** {session.file_error}.")
        if self._pending:
            changes = "; ".join(f"{label} {text}" for label, text in self._pending.items())
            lines.append(f"**Reset** applies: {changes}.")
        if session.waiting:
            lines.append(f"**Reset** drops {len(session.waiting)} changes that are still to come.")
        if session.misfit:
            name, sentence = session.misfit
            lines.append(f"The **{name}** goes on waiting, as it does not fit yet: {sentence}.")
        return "\n\n".join(lines)

    def _show_command(self) -> None:
        """Show the command that repeats the run, or why there is none."""
        try:
            command = copyable(self._session.command())
            text = "This command repeats the run so far, bit by bit."
        except UserError as error:
            command = ""
            text = f"No command repeats the run: {error}."
        show(self._repeats, "content", text)
        show(self._command, "content", command)


def describe_activity(activity: Activity | None) -> list[str]:
    """Return what a session prepares and for how long, in Markdown; empty for what is short."""
    if activity is None:
        return []
    seconds = time.monotonic() - activity.began
    if seconds < _SHORT_S:
        return []
    return [f"**Preparing** {activity.text}, {seconds:.0f} s so far. {activity.duration}"]


def _names_of_parts(scenario: PageScenario) -> tuple[str, ...]:
    """Return the names of strategy, task and engine."""
    return scenario.get("strategy"), scenario.get("task"), scenario.get("engine")


def _choice(name: str, choices: tuple[str, ...]) -> Control:
    """Return a control that is no setting of a run: a choice of words, at first the first one."""
    return Control(name, "", value=choices[0], choices=choices)


def _with_obstacle_at(arena: ArenaConfig, x: float, y: float) -> tuple[Obstacle, ...]:
    """Return the obstacles of an arena with another one, or without those that cover its place.

    Args:
        arena: arena with its obstacles.
        x: place of the new one [rd].
        y: place of the new one [rd].
    """
    point = np.array([[x, y]])
    elsewhere = tuple(box for box in arena.obstacles if distances(point, numbers([box]))[0] > 0)
    if len(elsewhere) < len(arena.obstacles):
        return elsewhere
    half_edge = _OBSTACLE_HALF_EDGE
    return (*elsewhere, (round(x, 2), round(y, 2), half_edge, half_edge, 0.0))
