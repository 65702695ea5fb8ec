"""Every client whose packages are installed runs its example, and the page is what the last runs say."""

import pytest

from docs.clients.page import PAGE, page
from docs.clients.running import LEAST_STEPS, read_record, run
from docs.clients.table import CLIENTS, EXAMPLES

RECORD = read_record()


@pytest.mark.slow
@pytest.mark.parametrize("name", CLIENTS)
def test_example_runs_where_its_client_is_installed(name: str) -> None:
    if missing := CLIENTS[name].missing():
        pytest.skip(f"not installed: {', '.join(missing)}")
    assert run(name).steps >= LEAST_STEPS


def test_every_example_is_in_the_table_and_no_other() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(CLIENTS)


def test_page_is_made_of_the_runs() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(RECORD)


@pytest.mark.parametrize("name", RECORD)
def test_recorded_run_stepped_and_names_its_versions(name: str) -> None:
    assert RECORD[name].steps >= LEAST_STEPS
    assert set(RECORD[name].versions) == set(CLIENTS[name].needs)
