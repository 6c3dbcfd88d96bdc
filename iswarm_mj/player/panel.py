"""The panel beside the swarm: buttons, controls made from declared settings, plots, and a robot's memory."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config import ArenaConfig
from iswarm_mj.output.palette import BLUE
from iswarm_mj.output.shapes import MILLIMETRES
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.bench import Bench
from iswarm_mj.player.changes import BALL, KILL, REVIVE
from iswarm_mj.player.controls import Control, controls
from iswarm_mj.player.inspection import described
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView
from iswarm_mj.player.widgets import AXIS, copied, show, spots, widget
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.utils.obstacles import Obstacle, distances, numbers
from iswarm_mj.utils.units import RD

SELECT, DROP, LIFE = "select a robot", "drop a ball", "kill or revive a robot"
REMOVE, BUILD = "remove a robot (at the next reset)", "put or take away an obstacle (at the next reset)"
"""What a click on the arena does."""
SWARM, GRIPPER = "the swarm", "the gripper's bench"
"""What the scene shows."""
THEME = {"show_logo": False, "show_share_button": False}
FASTEST = 60
"""Control steps a second at most."""
_OPEN = ("Rules of", "World", "Task")


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
        self._gui, self._session = gui, session
        self.view = SwarmView(server.scene, session.scene)
        self.looks = gui.add_dropdown("show", (SWARM, GRIPPER))
        self._play = gui.add_button("Play", icon="player-play", color="green")
        self._play.on_click(lambda _: session.post(self._toggled))
        more = gui.add_button_group("run", ("Step", "Reset"))
        more.on_click(lambda _: session.post({"Step": self._stepped, "Reset": session.reset}[more.value]))
        speed = gui.add_slider("speed [steps/s]", 1, FASTEST, 1, 10)
        self.speed = float(speed.value)
        speed.on_update(lambda _: setattr(self, "speed", float(speed.value)))
        self._status = gui.add_markdown("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Watch"):
            self._watch()
        self._rules, self._world = tabs.add_tab("Rules"), tabs.add_tab("World")
        for tab, text in ((self._rules, "These settings change at once."), (self._world, "These wait for **Reset**.")):
            with tab:
                gui.add_markdown(text)
        with tabs.add_tab("Robot"):
            self._robot = gui.add_markdown("Click on a robot: here it shows what it knows, hears and says.")
        with tabs.add_tab("Gripper"):
            self.bench = Bench(server, session.scene.arena_size * MILLIMETRES / 6)
        with tabs.add_tab("Share"):
            self._share()
        self._handles: dict[str, Any] = {}
        self._layout: list[str] = []
        self._shown: tuple[Any, ...] = ()
        self._plots: dict[str, Any] = {}
        self._compared, self._pending = (session.wanted, session.now), []
        self.click = SELECT

    def _toggled(self) -> None:
        self._session.is_playing = not self._session.is_playing

    def _stepped(self) -> None:
        self._session.is_playing = False
        self._session.advance()

    def _watch(self) -> None:
        """What is drawn, its legend, and the plots."""
        gui = self._gui
        self._by = gui.add_dropdown("colour by", (arrays.STATE,))
        self._by.on_update(lambda _: setattr(self.view, "by", self._by.value))
        self._draws = gui.add_button_group("draw", ("links", "trails"))
        self._draws.on_click(lambda _: self.view.toggle(self._draws.value))
        click = gui.add_dropdown("a click can", (SELECT, DROP, LIFE, REMOVE, BUILD))
        click.on_update(lambda _: setattr(self, "click", click.value))
        dark = gui.add_checkbox("dark page", False)
        dark.on_update(lambda _: gui.configure_theme(dark_mode=dark.value, **THEME))
        self._legend = gui.add_html("")
        self._graphs = gui.add_folder("Plots over control steps")

    def _share(self) -> None:
        gui, session = self._gui, self._session
        gui.add_markdown("This command repeats the run so far, bit by bit.")
        self._command = gui.add_html("")
        gui.add_button("Save as TOML", icon="download").on_click(
            lambda event: event.client and event.client.send_file_download("play.toml", session.toml().encode())
        )
        record = gui.add_checkbox("record for Rerun", False)
        place = gui.add_markdown("")

        def recorded() -> None:
            if record.value:
                place.content = f"Recording to `{session.start_recording()}`."
            else:
                session.stop_recording()
                place.content += " Saved; open it with `rerun`."

        record.on_update(lambda _: session.post(recorded))

    def rebuild(self) -> None:
        """Show the controls, the ways to colour and the plots of the present run."""
        session, view = self._session, self.view
        wanted = controls(session.wanted)
        layout = [control.name for control in wanted]
        if layout != self._layout:
            for handle in self._handles.values():
                handle.remove()
            self._layout, self._handles, folders = layout, {}, {}
            for control in wanted:
                is_rule = control.is_live
                key = (is_rule, control.group)
                if key not in folders:
                    with self._rules if is_rule else self._world:
                        is_open = control.group.startswith(_OPEN)
                        folders[key] = self._gui.add_folder(control.group, expand_by_default=is_open)
                        self._handles[f"/{key}"] = folders[key]
                with folders[key]:
                    self._handles[control.name] = widget(self._gui, control, partial(self._moved, control))
        self.synchronise()
        snapshot = session.snapshots[-1]
        self._by.options = tuple(arrays.ways_to_colour(session.scene, snapshot.frames, snapshot.energy))
        view.by = self._by.value
        self._draws.options = ("links", "trails", *view.vectors)
        if self._plots.keys() - session.lines.keys():  # of another task; viser keeps each removal for ever
            for plot in self._plots.values():
                plot.remove()
            self._plots = {}

    def synchronise(self) -> None:
        """Show the values of the present settings."""
        for control in controls(self._session.wanted):
            handle = self._handles.get(control.name)
            if handle is not None and handle.value != control.value:
                handle.value = control.value

    def _moved(self, control: Control, value: Any) -> None:
        self._session.post(lambda: self._session.set(control.name, type(control.value)(value)))

    def clicked(self, x: float, y: float, radius: float) -> None:
        """Act on a click on the floor at a place [mm]; robots nearer than a radius are meant."""
        session, view = self._session, self.view
        pose = session.snapshots[-1].frames.pose[0, :, :2] * 1e3
        distance = np.linalg.norm(pose - np.array([x, y]), axis=-1)
        robot = int(distance.argmin())
        is_hit = distance[robot] <= radius
        acts = {
            DROP: lambda: session.change(BALL, f"{x / RD:.3f},{y / RD:.3f}"),
            BUILD: lambda: session.set("arena.obstacles", _built(session.wanted.config.arena, x / RD, y / RD)),
        }
        if is_hit:
            acts[LIFE] = lambda: session.change(KILL if session.is_alive[robot] else REVIVE, str(robot))
            acts[REMOVE] = lambda: session.set("robots", session.wanted.n_robots - 1)
        if self.click in acts:
            session.post(acts[self.click])
        else:
            view.selected = robot if is_hit else None

    def update(self) -> None:
        """Show the state of the session; a few times a second."""
        session, view = self._session, self.view
        snapshot = session.snapshots[-1]
        label, icon, colour = (
            ("Pause", "player-pause", "orange") if session.is_playing else ("Play", "player-play", "green")
        )
        if self._play.label != label:
            self._play.label, self._play.icon, self._play.color = label, icon, colour
        if (settings := (session.wanted, session.now)) != self._compared:
            self._compared = settings
            now = {control.name: control.value for control in controls(session.now)}
            wanted = controls(session.wanted)
            self._pending = [control.label for control in wanted if control.value != now.get(control.name)]
            obstacles = session.wanted.config.arena.obstacles
            self._pending += ["obstacles"] * (obstacles != session.now.config.arena.obstacles)
            view.wish(obstacles if "obstacles" in self._pending else ())
        names = [Path(session.now.named(offer)).name for offer in (TASKS, STRATEGIES)]
        lines = [f"**step {session.step}** · {session.run.settings.n_robots} robots · {', '.join(names)}"]
        if session.is_busy and math.isinf(session.rate):
            lines.append("Preparing the first control step, which is compiled once for each number of robots.")
        elif math.isfinite(session.rate):
            lines[0] += f" · up to {session.rate:.0f} steps/s"
        if session.run.is_over:
            lines.append("Nothing is left to do.")
        if self._pending:
            lines.append(f"**Reset** applies: {', '.join(self._pending)}.")
        show(self._status, "content", "\n\n".join(lines))
        show(self._legend, "content", spots(arrays.legend(session.scene, view.by, session.is_alive)))
        show(self._command, "content", copied(session.command()))
        if view.selected is not None:
            show(
                self._robot,
                "content",
                described(session.scene, snapshot.frames, snapshot.record.swarm.memory, view.selected),
            )
        if (key := (session.version, session.step)) != self._shown:
            self._shown = key
            self._draw_plots()

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


def _built(arena: ArenaConfig, x: float, y: float) -> tuple[Obstacle, ...]:
    """Obstacles of an arena with another one of 2 x 2 rd at a place [rd], or without those that cover it."""
    point = np.array([[x, y]])
    left = tuple(one for one in arena.obstacles if distances(point, numbers([one]))[0] > 0)
    return left if len(left) < len(arena.obstacles) else (*left, (round(x, 2), round(y, 2), 1.0, 1.0, 0.0))
