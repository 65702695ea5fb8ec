"""The explorer in a real browser, where there is one: a few interactions of each kind without an error."""

import pytest

from benchmarks.explorer import browsed, explored, has_browser, interact


@pytest.mark.slow
@pytest.mark.skipif(not has_browser(), reason="takes Chromium")
def test_random_interactions_by_pointer_and_keys_make_no_errors() -> None:
    with explored("2RFR") as address, browsed(address, width=390, height=844) as page:
        assert page.value("document.documentElement.scrollWidth <= innerWidth")
        page.resize(1280, 1000)
        found = interact(page, 25)
    assert found.errors == []
    assert found.answers > 50
