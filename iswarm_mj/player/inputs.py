"""The inputs of the page: what browsers send is checked before viser keeps it."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any

from iswarm_mj.player.controls import Control
from iswarm_mj.player.widgets import warning, widget
from iswarm_mj.utils.errors import ConfigError, UserError, shown

Action = Callable[[Any], None]
"""What an input does with a new value, or a button with the browser in which it was clicked.

viser's event loop calls it, in the order of the messages, so it must take no time.
"""


_JUST_AFTER = 0.5
"""Place of a sentence after its input, in the numbers by which viser orders what folders hold."""


@dataclass(frozen=True)
class _Input:
    """An input as the page knows it."""

    control: Control
    """Setting that the input shows, with the values that it takes."""
    action: Action | None
    """Called with each new value."""
    gets_browser: bool = False
    """The action is called with the browser, as the value says nothing."""


class Inputs:
    """All inputs of a page, each with the values that it takes.

    A browser can send any message. viser converts its value to the type of the present one, sends
    that to other browsers, and even lets a message change how an input works. So each message is
    checked here first, by what the page itself knows of the input: its `Control`.
    """

    def __init__(
        self,
        server: Any,
        refused: Callable[[str], None],
        failed: Callable[[Exception], None],
    ):
        """Take the place of viser's own handler of changed inputs.

        Args:
            server: viser server of the page.
            refused: called with a sentence on a click that a button does not take.
            failed: called with what an input's action raised.
        """
        from viser._messages import GuiUpdateMessage

        self._server = server
        self._gui = server.gui
        self._message = GuiUpdateMessage
        self._refused = refused
        self._failed = failed
        self._inputs: dict[str, _Input] = {}
        self._new_notes: dict[str, str] = {}
        self._notes: dict[str, Any] = {}
        self._connection = self._gui._websock_interface
        self._connection.unregister_handler(GuiUpdateMessage, self._gui._handle_gui_updates)
        self._connection.register_handler(GuiUpdateMessage, self.receive)

    def add(self, control: Control, action: Action | None = None) -> Any:
        """Add an input for a control: a choice, a box to tick, a slider or a number.

        Args:
            control: setting that the input shows.
            action: called with each new value that a browser sends.
        """
        with self._server.atomic():
            handle = widget(self._gui, control)
            self._register(handle, _Input(control, action))
        return handle

    def add_button(self, label: str, action: Action, **look: Any) -> Any:
        """Add a button; `action` is called with the browser in which somebody clicks on it."""
        with self._server.atomic():
            handle = self._gui.add_button(label, **look)
            control = Control(label, "", value=True)
            self._register(handle, _Input(control, action, gets_browser=True))
        return handle

    def add_buttons(self, control: Control, action: Action) -> Any:
        """Add a row of buttons, one for each choice; `action` is called with that of the button."""
        with self._server.atomic():
            handle = self._gui.add_button_group(control.label, control.choices)
            self._register(handle, _Input(control, action))
        return handle

    def _register(self, handle: Any, known: _Input) -> None:
        """Take values of an input from now on.

        The block `atomic` around it keeps the input from browsers until then: a message that came
        earlier would be lost.
        """
        self._inputs[handle._impl.uuid] = known

    def controls(self) -> dict[str, Control]:
        """Return the control of each input by the identifier of the input."""
        return {uuid: known.control for uuid, known in self._inputs.items()}

    def offer(self, handle: Any, choices: tuple[str, ...]) -> None:
        """Let an input have other choices."""
        if tuple(handle.options) == choices:
            return
        uuid = handle._impl.uuid
        known = self._inputs[uuid]
        self._inputs[uuid] = replace(known, control=known.control._replace(choices=choices))
        handle.options = choices

    def forget(self, handle: Any) -> None:
        """Take no more values of an input that is removed."""
        self._inputs.pop(handle._impl.uuid, None)
        self._notes.pop(handle._impl.uuid, None)

    def refuse(self, handle: Any, error: UserError) -> None:
        """Let the page say beneath an input why it does not take a value; any thread may call."""
        known = self._inputs.get(handle._impl.uuid)
        if known is not None:
            self._new_notes[handle._impl.uuid] = _sentence(error, known.control)

    def clear_notes(self) -> None:
        """Take away all sentences on refused values, as a run begins with other settings."""
        for uuid in self._notes:
            self._new_notes[uuid] = ""

    def show_notes(self) -> bool:
        """Show the sentences on refused values beneath their inputs; return whether any is new.

        Only the thread that adds inputs may call this, as the sentences stand in their folders.
        """
        is_any_new = False
        for uuid, sentence in [*self._new_notes.items()]:
            # Another thread may have replaced it in the meantime; that one comes next time.
            if self._new_notes.get(uuid) == sentence:
                self._new_notes.pop(uuid)
            is_any_new |= bool(sentence)
            self._show_note(uuid, sentence)
        return is_any_new

    def _show_note(self, uuid: str, sentence: str) -> None:
        """Show a sentence beneath an input, or none where it is empty."""
        handle = self._gui._gui_input_handle_from_uuid.get(uuid)
        note = self._notes.get(uuid)
        if note is not None:
            note.content = warning(sentence) if sentence else ""
        elif handle is not None and sentence:
            container = self._gui._container_handle_from_uuid[handle._impl.parent_container_id]
            is_root = not hasattr(container, "__enter__")
            with nullcontext() if is_root else container:
                order = handle.order + _JUST_AFTER
                self._notes[uuid] = self._gui.add_html(warning(sentence), order=order)

    async def receive(self, client_id: int, message: Any) -> None:
        """Take the value that a browser sends, if it is one that the input takes, and act on it.

        Otherwise the input keeps its value, which all browsers are told.
        """
        handle = self._gui._gui_input_handle_from_uuid.get(message.uuid)
        known = self._inputs.get(message.uuid)
        if handle is None or known is None:
            return
        try:
            value = _checked(message, known.control)
        except UserError as error:
            if handle._impl.is_button:
                self._refused(_sentence(error, known.control))
            else:
                self.refuse(handle, error)
                self._connection.queue_message(self._message(message.uuid, {"value": handle.value}))
            return
        if message.uuid in self._notes or message.uuid in self._new_notes:
            self._new_notes[message.uuid] = ""

        # viser keeps the value and sends it to the other browsers.
        is_new = handle._impl.is_button or handle.value != value
        message.updates["value"] = value
        await self._gui._handle_gui_updates(client_id, message)
        if known.action is None or not is_new:
            return
        argument = self._server.get_clients().get(client_id) if known.gets_browser else value
        if argument is not None:
            self._act(known.action, argument)

    def _act(self, action: Action, argument: Any) -> None:
        """Call the action of an input; what it raises is shown on the page."""
        try:
            action(argument)
        except UserError as error:
            self._refused(str(error))
        except Exception as error:
            self._failed(error)


def _checked(message: Any, control: Control) -> Any:
    """Return the value of a message as a value of a control.

    Raises:
        UserError: the control does not take it, or the message changes something else.
    """
    if set(message.updates) != {"value"}:
        sent = ", ".join(map(str, message.updates))
        raise UserError(f"a browser can change values of inputs alone (got {shown(sent)})")
    return control.convert(message.updates["value"])


def _sentence(error: UserError, control: Control) -> str:
    """Return a sentence that calls the setting of a control by its name on the page."""
    # Numbers are called `n_robots` in Python where flags have `robots`.
    own_names = (control.name, f"n_{control.name}")
    if isinstance(error, ConfigError) and error.field in own_names:
        error = ConfigError(control.label, error.value, error.constraint, error.remedy)
    return str(error)
