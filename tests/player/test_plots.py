"""The plots of the page are saved as a table and as a picture."""

import csv
from io import BytesIO, StringIO

from PIL import Image
from support.page import draw, work

from iswarm_mj.player.plots import csv_of, png_of


def test_a_table_has_a_row_for_each_control_step(still):
    page, browser = still
    page.session.advance()
    browser.press("Save plots as CSV")
    rows = [*csv.reader(StringIO(browser.files[-1].decode()))]
    lines = page.session.lines
    assert [title.partition(" [")[0] for title in rows[0]] == [*lines]
    assert "mean_speed [m/s]" in rows[0]
    assert [float(row[0]) for row in rows[1:]] == lines["step"] == [0, 1, 2]
    assert [row[-1] for row in rows[1:]] == [f"{speed:.9g}" for speed in lines["mean_speed"]]


def test_plots_can_be_saved_once_there_are_some(new):
    page, browser = new
    save_button = browser.handle(browser.find("Save plots as CSV"))
    draw(page)
    assert not save_button.visible

    page.session.advance()
    draw(page)
    assert save_button.visible


def test_a_picture_has_a_plot_for_each_metric(still):
    page, browser = still
    page.session.advance()
    browser.press("Save plots as PNG")
    assert not browser.files  # the session's thread draws it
    work(page)
    whole = Image.open(BytesIO(browser.files[-1]))
    few = Image.open(BytesIO(png_of({"step": [0, 1], "delivered": [0, 3]}, {})))
    n_metrics = len(page.session.lines) - 1
    assert whole.height == n_metrics * few.height
    assert len(few.getcolors(100_000)) > 2  # white, axes and a line


def test_units_stand_in_brackets():
    table = csv_of({"step": [0, 1], "speed": [0.5, 0.25], "n": [1, 2]}, {"speed": "m/s", "n": ""})
    assert table == b"step,speed [m/s],n\n0,0.5,1\n1,0.25,2\n"
