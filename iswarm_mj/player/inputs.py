"""The inputs of the page: what browsers send is checked before viser keeps it."""

from collections.abc import Callable
from typing import Any

from iswarm_mj.player.controls import Control
from iswarm_mj.player.widgets import widget
from iswarm_mj.utils.errors import ConfigError, UserError, shown

Act = Callable[[Any], None]
"""What an input does with a value that it takes; called by viser's event loop, in the order of the
messages, so that it must take no time."""


class Inputs:
    """All inputs of a page, each with the values that it takes.

    A browser can send any message. viser converts its value to the type of the present one, sends
    that to other browsers, and even lets a message change how an input works. So each message is
    checked here first, by what the page itself knows of the input: its `Control`.
    """

    def __init__(self, server: Any, refused: Callable[[str], None], failed: Callable[[Exception], None]):
        """Take the place of viser's own handler of changed inputs.

        Args:
            server: of viser.
            refused: called with a sentence on a value that an input does not take.
            failed: called with what an input's action raised.
        """
        from viser._messages import GuiUpdateMessage

        self._gui = server.gui
        self._message = GuiUpdateMessage
        self._refused = refused
        self._failed = failed
        self._controls: dict[str, Control] = {}
        self._connection = self._gui._websock_interface
        self._connection.unregister_handler(GuiUpdateMessage, self._gui._handle_gui_updates)
        self._connection.register_handler(GuiUpdateMessage, self.receive)

    def add(self, control: Control, act: Act | None = None) -> Any:
        """Add an input for a control: a choice, a box to tick, a slider or a number.

        Args:
            control: setting that the input shows.
            act: called with each new value of a browser's.
        """
        handle = widget(self._gui, control)
        self._controls[handle._impl.uuid] = control
        if act is not None:
            handle.on_update(self._guarded(lambda event: act(event.target.value)))
        return handle

    def add_button(self, label: str, act: Act, **look: Any) -> Any:
        """Add a button; `act` is called with the browser in which somebody clicks on it."""
        handle = self._gui.add_button(label, **look)
        self._controls[handle._impl.uuid] = Control(label, "", value=True)
        handle.on_click(self._guarded(lambda event: act(event.client)))
        return handle

    def add_buttons(self, control: Control, act: Act) -> Any:
        """Add a row of buttons, one for each choice; `act` is called with that of the button."""
        handle = self._gui.add_button_group(control.label, control.choices)
        self._controls[handle._impl.uuid] = control
        handle.on_click(self._guarded(lambda event: act(event.target.value)))
        return handle

    def _guarded(self, act: Act) -> Any:
        """Return what viser calls with an event; it raises nothing."""

        async def acted(event: Any) -> None:
            if event.client is None:  # the page itself has set a value
                return
            try:
                act(event)
            except UserError as error:
                self._refused(str(error))
            except Exception as error:
                self._failed(error)

        return acted

    def offer(self, handle: Any, choices: tuple[str, ...]) -> None:
        """Let an input have other choices."""
        if tuple(handle.options) != choices:
            uuid = handle._impl.uuid
            self._controls[uuid] = self._controls[uuid]._replace(choices=choices)
            handle.options = choices

    def forget(self, handle: Any) -> None:
        """Take no more values of an input that is removed."""
        self._controls.pop(handle._impl.uuid, None)

    async def receive(self, client_id: int, message: Any) -> None:
        """Pass a message of a browser on to viser if its value is one that the input takes.

        Otherwise the input keeps its value, which all browsers are told.
        """
        handle = self._gui._gui_input_handle_from_uuid.get(message.uuid)
        control = self._controls.get(message.uuid)
        if handle is None or control is None:
            return
        try:
            if set(message.updates) != {"value"}:
                sent = ", ".join(map(str, message.updates))
                raise UserError(f"a browser can change values of inputs alone (got {shown(sent)})")
            message.updates["value"] = control.check(message.updates["value"])
        except UserError as error:
            self._refused(_sentence(error, control))
            if not handle._impl.is_button:
                update = {"value": handle.value}
                self._connection.queue_message(self._message(message.uuid, update))
            return
        await self._gui._handle_gui_updates(client_id, message)


def _sentence(error: UserError, control: Control) -> str:
    """Return a sentence that calls a setting by its name on the page."""
    if isinstance(error, ConfigError):
        error = ConfigError(control.label, error.value, error.constraint, error.remedy)
    return str(error)
