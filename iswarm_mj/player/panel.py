"""The panel beside the swarm: buttons, controls made from declared settings, plots, and a robot's memory."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.geometry.obstacles import Obstacle, distances, numbers
from iswarm_mj.output.palette import BLUE
from iswarm_mj.output.shapes import MILLIMETRES
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.bench import Bench
from iswarm_mj.player.changes import BALL, KILL, REVIVE
from iswarm_mj.player.controls import Control
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.inspection import described
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.settings_tabs import SettingsTabs
from iswarm_mj.player.view import SwarmView
from iswarm_mj.player.widgets import AXIS, copied, show, spots
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

SELECT, DROP, LIFE = "select a robot", "drop a ball", "kill or revive a robot"
REMOVE, BUILD = "remove a robot (at the next reset)", "put or take away an obstacle (at the next reset)"
"""What a click on the arena does."""
SWARM, GRIPPER = "the swarm", "the gripper's bench"
"""What the scene shows."""
THEME = {"show_logo": False, "show_share_button": False}
FASTEST = 60
"""Control steps a second at most."""


class Panel:
    """Controls of a session; each is the same in all browsers.

    Attributes:
        view: of the swarm.
        looks: choice of what the scene shows.
        bench: of the gripper.
        speed: control steps a second that are wanted.
        click: what a click on the arena does.
    """

    def __init__(self, server: Any, session: Session):
        """Draw the swarm, and make the controls.

        Args:
            server: of viser.
            session: that they act on.
        """
        gui = server.gui
        self._gui = gui
        self._session = session
        self._inputs = Inputs(server, refused=session.messages.put, failed=session.fail)
        self.view = SwarmView(server.scene, session.scene)
        self.click = SELECT
        self._ways = (arrays.STATE,)
        self._shown: tuple[Any, ...] = ()
        self._plots: dict[str, Any] = {}

        self._add_run_controls()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Watch"):
            self._add_watch_tab()
        rules, world = tabs.add_tab("Rules"), tabs.add_tab("World")
        with rules:
            gui.add_markdown("These settings change at once.")
        with world:
            gui.add_markdown("These wait for **Reset**.")
        self._settings = SettingsTabs(gui, self._inputs, session, rules, world)
        self._compared = (session.wanted, session.now)
        self._chosen = _chosen(session.wanted)
        self._pending: list[str] = []
        with tabs.add_tab("Robot"):
            self._robot = gui.add_markdown("Click on a robot: here it shows what it knows, hears and says.")
        with tabs.add_tab("Gripper"):
            self.bench = Bench(server, self._inputs, session.scene.arena_size * MILLIMETRES / 6)
        with tabs.add_tab("Share"):
            self._add_share_tab()

    def _add_run_controls(self) -> None:
        """Add what stands above the tabs."""
        session = self._session
        self.looks = self._inputs.add(_choice("show", (SWARM, GRIPPER)))

        def toggle() -> None:
            session.is_playing = not session.is_playing

        def step() -> None:
            session.is_playing = False
            session.advance()

        self._play = self._inputs.add_button("Play", lambda _: session.post(toggle), icon="player-play", color="green")
        acts = {"Step": step, "Reset": session.reset}
        self._inputs.add_buttons(_choice("run", tuple(acts)), lambda name: session.post(acts[name]))

        speed = Control("speed", "", 10, low=1, high=FASTEST, unit="steps/s")
        self.speed = float(speed.value)
        self._inputs.add(speed, lambda value: setattr(self, "speed", float(value)))
        self._status = self._gui.add_markdown("")

    def _add_watch_tab(self) -> None:
        """Add what is drawn, its legend, and the plots."""
        gui, inputs = self._gui, self._inputs
        self._colour = inputs.add(_choice("colour by", (arrays.STATE,)), lambda value: setattr(self.view, "by", value))
        self._draws = inputs.add_buttons(_choice("draw", ("links", "trails")), lambda name: self.view.toggle(name))
        inputs.add(
            _choice("a click can", (SELECT, DROP, LIFE, REMOVE, BUILD)),
            lambda value: setattr(self, "click", value),
        )
        inputs.add(
            Control("dark page", "", False),
            lambda value: gui.configure_theme(dark_mode=value, **THEME),
        )
        self._legend = gui.add_html("")
        self._graphs = gui.add_folder("Plots over control steps")

    def _add_share_tab(self) -> None:
        """Add the command, the file and the recording."""
        gui, session = self._gui, self._session
        self._repeats = gui.add_markdown("")
        self._command = gui.add_html("")

        def download(client: Any) -> None:
            client.send_file_download("play.toml", session.toml().encode())

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
        """Show the controls, the ways to colour and the plots of the present run."""
        session, view = self._session, self.view
        self._settings.rebuild()
        self._settings.synchronise()
        snapshot = session.snapshots[-1]
        self._ways = tuple(arrays.ways_to_colour(session.scene, snapshot.frames, snapshot.energy))
        self._inputs.offer(self._colour, self._ways)
        view.by = self._colour.value
        self._inputs.offer(self._draws, ("links", "trails", *view.vectors))

        # Plots of another task; viser keeps each removal for ever.
        if self._plots.keys() - session.lines.keys():
            for plot in self._plots.values():
                plot.remove()
            self._plots = {}

    def synchronise(self) -> None:
        """Show the values of the present settings."""
        self._settings.synchronise()

    def clicked(self, x: float, y: float, radius: float) -> None:
        """Act on a click on the floor at a place [mm]; robots nearer than a radius are meant."""
        session = self._session
        with session.lock:  # no reset comes between the robots and the view
            positions = session.snapshots[-1].frames.pose[0, :, :2] * 1e3
            distance = np.linalg.norm(positions - np.array([x, y]), axis=-1)
            robot = int(distance.argmin())
            is_hit = distance[robot] <= radius
            if self.click == SELECT:
                self.view.selected = robot if is_hit else None

        def drop() -> None:
            session.change(BALL, f"{x / RD:.3f},{y / RD:.3f}")

        def build() -> None:
            arena = session.wanted.config.arena
            session.want("arena.obstacles", _built(arena, x / RD, y / RD))

        def kill_or_revive() -> None:
            is_dead = robot < len(session.is_alive) and not session.is_alive[robot]
            session.change(REVIVE if is_dead else KILL, str(robot))

        def remove() -> None:
            session.want("robots", max(1, session.wanted.n_robots - 1))
            self.synchronise()

        acts = {DROP: drop, BUILD: build}
        if is_hit:
            acts |= {LIFE: kill_or_revive, REMOVE: remove}
        if self.click in acts:
            session.post(acts[self.click])

    def update(self) -> None:
        """Show the state of the session; a few times a second."""
        session, view = self._session, self.view
        settings = (session.wanted, session.now)
        if any(one is not other for one, other in zip(settings, self._compared, strict=True)):
            self._compared = settings
            self._take_settings(session.wanted)

        label, icon, colour = "Play", "player-play", "green"
        if session.is_playing:
            label, icon, colour = "Pause", "player-pause", "orange"
        if self._play.label != label:
            self._play.label, self._play.icon, self._play.color = label, icon, colour
        show(self._status, "content", self._describe_run())
        if view.by not in self._ways:  # chosen while another task came
            view.by = self._ways[0]
            show(self._colour, "value", view.by)
        legend = arrays.legend(session.scene, view.by, session.is_alive)
        show(self._legend, "content", spots(legend))
        self._show_command()
        if self._shown_recording != (session.is_recording, session.recording):
            self._show_recording()  # which a reset, or areas that move, have ended
        if view.selected is not None:
            snapshot = session.snapshots[-1]
            memory = snapshot.record.swarm.memory
            text = described(session.scene, snapshot.frames, memory, view.selected)
            show(self._robot, "content", text)
        key = (session.version, session.step)
        if key != self._shown:
            self._shown = key
            self._draw_plots()

    def _take_settings(self, wanted: PageScenario) -> None:
        """Show the inputs of changed settings, and what waits for a reset."""
        self._settings.rebuild()
        chosen = _chosen(wanted)
        if chosen != self._chosen:
            # Another strategy brings its own values. Otherwise inputs show what browsers sent,
            # which the session may not have taken yet: a slider would jump back while it is moved.
            self._chosen = chosen
            self._settings.synchronise()
        self._pending = self._session.pending
        is_built = "obstacles" in self._pending
        self.view.wish(wanted.config.arena.obstacles if is_built else ())

    def _describe_run(self) -> str:
        """Return what the run is and what it waits for, in Markdown."""
        session = self._session
        names = [Path(session.now.named(offer)).name for offer in (TASKS, STRATEGIES)]
        n_robots = session.run.settings.n_robots
        lines = [f"**step {session.step}** · {n_robots} robots · {', '.join(names)}"]
        if session.is_busy and math.isinf(session.rate):
            lines.append("Preparing the first control step, which is compiled once for each number of robots.")
        elif math.isfinite(session.rate):
            lines[0] += f" · up to {session.rate:.0f} steps/s"
        if session.run.is_over:
            lines.append("Nothing is left to do.")
        if self._pending:
            lines.append(f"**Reset** applies: {', '.join(self._pending)}.")
        return "\n\n".join(lines)

    def _show_command(self) -> None:
        """Show the command that repeats the run, or why there is none."""
        try:
            command = copied(self._session.command())
            text = "This command repeats the run so far, bit by bit."
        except UserError as error:
            command = ""
            text = f"No command repeats the run: {error}."
        show(self._repeats, "content", text)
        show(self._command, "content", command)

    def _draw_plots(self) -> None:
        lines = {name: list(values) for name, values in self._session.lines.items()}
        n = min(map(len, lines.values()))  # another thread adds to them
        steps = np.array(lines.pop("step")[-n:])
        for name, values in lines.items():
            data = (steps, np.array(values[-n:]))
            if name in self._plots:
                self._plots[name].data = data
            elif n > 1:
                with self._graphs:
                    self._plots[name] = self._gui.add_uplot(
                        data,
                        ({"label": "step"}, {"label": name, "stroke": BLUE, "width": 2, "points": {"show": False}}),
                        title=name.replace("_", " "),
                        scales={"x": {"time": False}},
                        legend={"show": False},
                        axes=(AXIS, AXIS),
                        height=130,
                    )


def _chosen(scenario: PageScenario) -> tuple[str, ...]:
    """Return the names of strategy, task and engine."""
    return scenario.get("strategy"), scenario.get("task"), scenario.get("engine")


def _choice(name: str, choices: tuple[str, ...]) -> Control:
    """Return a control that is no setting of a run: a choice of words, at first the first one."""
    return Control(name, "", value=choices[0], choices=choices)


def _built(arena: ArenaConfig, x: float, y: float) -> tuple[Obstacle, ...]:
    """Obstacles of an arena with another one of 2 x 2 rd at a place [rd], or without those that cover it."""
    point = np.array([[x, y]])
    left = tuple(one for one in arena.obstacles if distances(point, numbers([one]))[0] > 0)
    return left if len(left) < len(arena.obstacles) else (*left, (round(x, 2), round(y, 2), 1.0, 1.0, 0.0))
