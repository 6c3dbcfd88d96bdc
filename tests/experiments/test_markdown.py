"""Words of others in pages."""

from hypothesis import given
from hypothesis import strategies as st

from iswarm_mj.experiments.report.numbers import text


@given(st.text())
def test_text_is_no_markup(words):
    shown = text(words)
    assert "\n" not in shown and "](" not in shown
    assert "<a" not in shown and "<!" not in shown and "</" not in shown
    assert "|" not in shown.replace("\\|", "")


def test_words_by_hand():
    assert text("p < 0.001 | a") == "p < 0.001 \\| a"
    assert text("<script>x</script> ![i](http://a)") == "&lt;script>x&lt;/script> ![i]\\(http://a)"
