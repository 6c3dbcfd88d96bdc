"""The inbox of a session: work that browsers ask for, of which only so much can wait."""

from collections.abc import Callable
from threading import Lock

from iswarm_mj.utils.errors import UserError

MOST_CLICKS = 30
"""Largest number of clicks that wait for the session."""
Call = Callable[[], None]
"""Something that the thread of the session does."""


class Inbox:
    """Calls that wait for the thread of a session, in the order in which they arrived.

    Whoever has the address of a page can send messages faster than a session works. So only
    `MOST_CLICKS` clicks wait, and of each control only the latest value between two clicks: a
    slider that is moved while a program is compiled leaves one value, and a value that was set
    before a click on Reset is not mistaken for one that was set after it.
    """

    def __init__(self) -> None:
        """Begin empty."""
        self._lock = Lock()
        self._waiting: dict[tuple[int, str | None], Call] = {}
        self._n_clicks = 0
        self._n_waiting_clicks = 0

    def put_click(self, call: Call) -> None:
        """Append a call that is made once for each click.

        Raises:
            UserError: too many clicks wait.
        """
        with self._lock:
            if self._n_waiting_clicks >= MOST_CLICKS:
                raise UserError(
                    f"{MOST_CLICKS} clicks wait already, as something takes long; "
                    "click again when the page has done them"
                )
            self._waiting[self._n_clicks, None] = call
            self._n_clicks += 1
            self._n_waiting_clicks += 1

    def put_value(self, control: str, call: Call) -> None:
        """Append a call that sets a control, in place of one that waits since the latest click.

        Args:
            control: unique name of the control.
            call: sets it to its new value.
        """
        with self._lock:
            key = (self._n_clicks, control)
            self._waiting.pop(key, None)
            self._waiting[key] = call

    def take(self) -> Call | None:
        """Remove and return the call that waits longest; None if there is none."""
        with self._lock:
            if not self._waiting:
                return None
            key = next(iter(self._waiting))
            if key[1] is None:
                self._n_waiting_clicks -= 1
            return self._waiting.pop(key)

    def __len__(self) -> int:
        """Return the number of calls that wait."""
        return len(self._waiting)
