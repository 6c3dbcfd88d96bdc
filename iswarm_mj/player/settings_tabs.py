"""The tabs Rules and World: an input for each setting of the run, in folders."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from iswarm_mj.player.controls import Control, in_page_units
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.session import Session
from iswarm_mj.player.widgets import show
from iswarm_mj.utils.errors import UserError

_OPEN = ("Rules of", "World", "Task")
"""Beginnings of the names of folders that are open at first."""
_AFTER_TEXT = 1e6
"""Place of the first folder in its tab: viser numbers what has no place of its own from below."""


class _FolderKey(NamedTuple):
    """Tab and name of a folder."""

    is_live: bool
    """The folder is in the tab of rules, which change at once."""
    name: str


@dataclass
class _Folder:
    """A folder of a tab with its inputs."""

    controls: list[Control]
    """Controls of the inputs."""
    handle: Any
    """Folder of viser."""
    inputs: dict[str, Any] = field(default_factory=dict)
    """Inputs by the names of their controls."""


class SettingsTabs:
    """Inputs for the settings of a session."""

    def __init__(self, gui: Any, inputs: Inputs, session: Session, rules: Any, world: Any):
        """Take two tabs, and leave them without inputs.

        Args:
            gui: panel of a viser server.
            inputs: inputs of the page.
            session: whose settings they are.
            rules: tab of settings that change at once.
            world: tab of settings that wait for a reset.
        """
        self._gui = gui
        self._inputs = inputs
        self._session = session
        self._rules = rules
        self._world = world
        self._folders: dict[_FolderKey, _Folder] = {}

    def rebuild(self) -> None:
        """Show an input for each present setting; folders whose settings stay are left alone."""
        wanted = self._grouped()
        for key, folder in [*self._folders.items()]:
            if _kinds(wanted.get(key, [])) != _kinds(folder.controls):
                self._remove(key)
        for order, (key, controls) in enumerate(wanted.items()):
            if key not in self._folders:
                self._add(key, controls, order)

    def synchronise(self) -> None:
        """Show the values of the present settings."""
        for key, controls in self._grouped().items():
            folder = self._folders.get(key)
            if folder is None:
                continue
            for control in controls:
                if control.name in folder.inputs:
                    show(folder.inputs[control.name], "value", control.value)

    def note(self, name: str, sentence: str) -> None:
        """Show a sentence beneath the input of a setting that waits."""
        for key, folder in self._folders.items():
            if not key.is_live and name in folder.inputs:
                self._inputs.refuse(folder.inputs[name], UserError(sentence))

    def _remove(self, key: _FolderKey) -> None:
        """Remove a folder and its inputs."""
        folder = self._folders.pop(key)
        for handle in folder.inputs.values():
            self._inputs.forget(handle)
        folder.handle.remove()  # and with it all inputs

    def _add(self, key: _FolderKey, controls: list[Control], order: int) -> None:
        """Add a folder with an input for each of some controls, at its place in the tab."""
        with self._rules if key.is_live else self._world:
            handle = self._gui.add_folder(
                key.name,
                order=_AFTER_TEXT + order,
                expand_by_default=key.name.startswith(_OPEN),
            )
        folder = _Folder(controls, handle)
        with handle:
            for control in controls:
                move = partial(self._move, folder, control)
                folder.inputs[control.name] = self._inputs.add(control, move)
        self._folders[key] = folder

    def _move(self, folder: _Folder, control: Control, value: Any) -> None:
        """Let the session change a setting, of what runs or of what waits.

        What the session refuses stands beneath the input, which shows its old value again.
        """
        set_or_want = self._session.set if control.is_live else self._session.want
        tab = "rules" if control.is_live else "world"

        def change() -> None:
            try:
                set_or_want(control.name, control.of_setting(value))
            except UserError as error:
                self._inputs.refuse(folder.inputs[control.name], error)

        self._session.post(change, control=f"{tab} {control.name}")

    def _grouped(self) -> dict[_FolderKey, list[Control]]:
        """Return the controls of each folder, in the units of the page."""
        folders: dict[_FolderKey, list[Control]] = {}
        for control in self._session.controls():
            key = _FolderKey(control.is_live, control.group)
            folders.setdefault(key, []).append(in_page_units(control))
        return folders


def _kinds(controls: list[Control]) -> list[Control]:
    """Return controls with the types of their values in place of these."""
    return [control._replace(value=type(control.value)) for control in controls]
