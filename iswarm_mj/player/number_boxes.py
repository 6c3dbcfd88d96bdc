"""Number boxes that apply on Enter or when they are left, and not at each key.

viser 1.1 sends what a box holds at each key, so that `0.3` would first set 0. It has no option for
that, so the page runs a script in each browser.
"""

from typing import Any

SCRIPT = """
if (!window.numberBoxesWait) {
  window.numberBoxesWait = true;
  const textBefore = new WeakMap();  // of boxes in which somebody has typed
  const setText = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
  const isNumberBox = (element) => element.matches?.("input[inputmode]");
  let isApplying = false;

  // The box's component takes a text for what was typed only if it saw the keys. It sees one key
  // here, with all of the old text selected, and then the new text in its place.
  const apply = (box) => {
    if (!textBefore.has(box)) return;
    const text = box.value;
    setText.call(box, textBefore.get(box));
    textBefore.delete(box);
    box.select();
    isApplying = true;
    box.dispatchEvent(new KeyboardEvent("keydown", {key: "Unidentified", bubbles: true}));
    setText.call(box, text);
    box.dispatchEvent(new Event("input", {bubbles: true}));
    isApplying = false;
  };

  const on = (name, act) => window.addEventListener(name, (event) => {
    if (!isApplying && isNumberBox(event.target)) act(event, event.target);
  }, true);
  on("beforeinput", (event, box) => {
    if (!textBefore.has(box)) textBefore.set(box, box.value);
  });
  on("input", (event) => event.stopPropagation());
  on("keydown", (event, box) => {
    if (["Enter", "Tab", "ArrowUp", "ArrowDown"].includes(event.key)) apply(box);
  });
  // The component sends its value again when the box is left, perhaps an older one than the text.
  on("focusout", (event, box) => {
    apply(box);
    event.stopPropagation();
  });
}
"""
"""Script that keeps keys in a number box from viser's client until the box is left."""


def let_number_boxes_wait(server: Any) -> None:
    """Let the number boxes of all browsers apply on Enter or when they are left.

    Args:
        server: viser server of the page.
    """
    from viser._messages import RunJavascriptMessage

    server.gui._websock_interface.queue_message(RunJavascriptMessage(source=SCRIPT))
