"""The explorer over its socket: what it answers is what the library says, and what it must refuse it refuses."""

import http.client
import itertools
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import pcm_gym
from pcm_gym.explorer.session import RHO_MAX
from tests.explorer.serving import Browser, Served, browser, served


@pytest.fixture(scope="module")
def explorer() -> Iterator[Served]:
    with served("2RFR") as own:
        yield own


@pytest.fixture
def page(explorer: Served) -> Iterator[Browser]:
    with browser(explorer) as own:
        yield own


def chosen(state: Any) -> Any:
    return state["equilibria"][state["number"]]


def test_the_page_and_its_files_are_served_and_nothing_else(explorer: Served) -> None:
    for path, status in (
        ("/", 200),
        ("/explorer.js", 200),
        ("/drawing.js", 200),
        ("/explorer.css", 200),
        ("/x", 404),
        ("/../session.py", 404),
    ):
        connection = http.client.HTTPConnection(explorer.host, timeout=60)
        connection.request("GET", path)
        answer = connection.getresponse()
        assert answer.status == status
        assert "default-src 'self'" in (answer.getheader("Content-Security-Policy") or "")
        body = answer.read().decode()
        assert "http://" not in body.replace("http://www.w3.org", "")
        assert "https://" not in body


def test_it_is_bound_to_loopback(explorer: Served) -> None:
    assert explorer.host.startswith("127.0.0.1:")


def test_the_greeting_tells_every_equilibrium_at_home(page: Browser) -> None:
    home = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR"))
    wanted = pcm_gym.solve_forward(home.mechanism, home.inputs, rho_max=RHO_MAX)
    state = page.greeting["state"]
    assert page.greeting["mechanism"]["name"] == "2RFR"
    assert [each["energy"] for each in state["equilibria"]] == [each.energy for each in wanted]
    assert [each["index"] for each in state["equilibria"]] == [each.index for each in wanted]
    np.testing.assert_allclose(chosen(state)["pose"], home.pose, atol=1e-12)
    torques = [each["efforts"] for each in state["equilibria"]]
    np.testing.assert_allclose(torques, [each.actuator_forces for each in wanted])


def test_a_drag_brings_the_end_effector_to_the_pointer(page: Browser) -> None:
    x, y = chosen(page.greeting["state"])["pose"]
    for step in range(1, 6):
        state = page.ask("drag", place=[x + 0.01 * step, y - 0.01 * step])
        assert state["kind"] == "state"
        np.testing.assert_allclose(chosen(state)["pose"], [x + 0.01 * step, y - 0.01 * step], atol=1e-4)
    there = pcm_gym.solve_forward(pcm_gym.get_mechanism("2RFR"), state["inputs"])
    assert min(np.abs(each.pose - chosen(state)["pose"]).max() for each in there) < 1e-9


def test_driving_past_a_fold_snaps_as_the_library_does(page: Browser) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    home = pcm_gym.home_equilibrium(mechanism)
    corners = [np.array(pair) for pair in itertools.product(*(leg.actuator.limits for leg in mechanism.legs))]
    steps = [(pcm_gym.BranchTracker(mechanism, home).step(corner), corner) for corner in corners]
    step, target = next(each for each in steps if each[0].event == pcm_gym.Event.FOLD)
    state = page.ask("drive", inputs=target.tolist())
    landing = pcm_gym.snap(step.equilibrium)
    assert state["event"] == "fold"
    assert state["fall"]["is_landed"]
    np.testing.assert_allclose(chosen(state)["pose"], landing.equilibrium.pose, atol=1e-9)
    assert state["fall"]["energy_released"] == pytest.approx(landing.energy_released)
    np.testing.assert_allclose(state["fall"]["from"]["pose"], step.equilibrium.pose, atol=1e-9)
    assert chosen(state)["is_stable"]


def test_inputs_beyond_the_limits_end_at_them(page: Browser) -> None:
    page.ask("choose", name="2PFR")
    state = page.ask("drive", inputs=[100.0, 0.0])
    limit = pcm_gym.get_mechanism("2PFR").upper_limits[0]
    assert state["inputs"][0] <= limit


def test_another_equilibrium_is_picked_and_an_unstable_one_let_fall(page: Browser) -> None:
    state = page.greeting["state"]
    number = next(n for n, each in enumerate(state["equilibria"]) if each["index"] == 1)
    picked = page.ask("pick", number=number)
    assert picked["number"] == number
    fallen = page.ask("release")
    assert fallen["fall"]["is_landed"]
    assert chosen(fallen)["energy"] < state["equilibria"][number]["energy"]
    assert page.ask("pick", number=10_000)["kind"] == "refused"
    assert page.ask("release")["kind"] == "refused"  # of a stable one


def test_a_load_is_taken_up_along_the_branch(page: Browser) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    home = pcm_gym.home_equilibrium(mechanism)
    load = (2.0 * mechanism.units.load).tolist()
    wanted = pcm_gym.BranchTracker(mechanism, home).step(home.inputs, load).equilibrium
    state = page.ask("load", load=load)
    np.testing.assert_allclose(chosen(state)["pose"], wanted.pose, atol=1e-9)
    assert state["load"] == load


def test_the_diagram_is_the_library_s_and_leads_to_its_states(page: Browser) -> None:
    home = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR"))
    told = page.ask("diagram", along="input", axis=0)
    assert told["kind"] == "diagram"
    limits = home.mechanism.legs[0].actuator.limits
    ends = np.tile(home.inputs, (2, 1))
    ends[:, 0] = limits
    wanted = pcm_gym.bifurcation_diagram(home.mechanism, {"inputs": ends}, RHO_MAX)
    assert len(told["branches"]) == len(wanted.branches)
    assert [point["kind"] for point in told["points"]] == [str(point.kind) for point in wanted.points]
    branch, vertex = len(wanted.branches) - 1, 1
    there = wanted.branches[branch].equilibrium(vertex)
    state = page.ask("go", branch=branch, vertex=vertex)
    np.testing.assert_allclose(chosen(state)["pose"], there.pose, atol=1e-9)
    np.testing.assert_allclose(state["inputs"], there.inputs)
    assert page.ask("go", branch=branch, vertex=1 << 19)["kind"] == "refused"
    assert page.ask("diagram", along="input", axis=2)["kind"] == "refused"


def test_the_map_of_folds_is_the_library_s(page: Browser) -> None:
    told = page.ask("folds")
    wanted = pcm_gym.forward_singularities(pcm_gym.get_mechanism("2RFR"), progress=False, grid=6)
    assert [curve["is_limit"] for curve in told["curves"]] == [curve.is_stability_limit for curve in wanted]
    np.testing.assert_allclose(told["curves"][0]["inputs"][0], wanted[0].points[0], atol=1e-6)


def test_python_lines_make_the_same_state(page: Browser) -> None:
    x, y = chosen(page.greeting["state"])["pose"]
    state = page.ask("drag", place=[x + 0.05, y - 0.05])
    names: dict[str, Any] = {}
    exec(page.ask("export", form="python")["text"], names)
    np.testing.assert_allclose(names["equilibrium"].pose, chosen(state)["pose"], atol=1e-10)
    content = json.loads(page.ask("export", form="json")["text"])
    assert content["inputs"] == state["inputs"]
    assert page.ask("export", form="svg")["text"].startswith("<svg")


def test_a_mechanism_from_a_file_is_taken_and_a_wrong_one_refused(page: Browser, tmp_path: Any) -> None:
    mechanism = pcm_gym.get_mechanism("2PFR")
    pcm_gym.save_mechanism(mechanism, tmp_path / "own.json")
    text = (tmp_path / "own.json").read_text()
    assert page.ask("read", text=text)["mechanism"]["name"] == "2PFR"
    assert page.ask("read", text=text.replace("1.0", "-1.0"))["kind"] == "refused"
    assert page.ask("choose", name="no such mechanism")["kind"] == "refused"
    assert page.ask("export", form="python")["kind"] == "file"  # the last good one is still there


MALFORMED = [
    "",
    "{",
    "[]",
    "null",
    '{"kind": "nothing"}',
    '{"kind": "drag"}',
    '{"kind": "drag", "place": [NaN, 0.0]}',
    '{"kind": "drag", "place": [1e400, 0.0]}',
    '{"kind": "drag", "place": [0.0]}',
    '{"kind": "drag", "place": ["0", "1"]}',
    '{"kind": "pick", "number": -1}',
    '{"kind": "pick", "number": 1.5}',
    '{"kind": "pick", "number": true}',
    '{"kind": "pick", "number": 0, "more": 1}',
    '{"kind": "pick", "number": 0, "id": -1}',
    "[" * 30_000,
    b"\x00\x01",
]


@pytest.mark.parametrize("text", MALFORMED, ids=range(len(MALFORMED)))
def test_malformed_messages_are_refused_and_the_session_goes_on(page: Browser, text: str | bytes) -> None:
    answer = page.send(text)
    assert answer["kind"] == "refused"
    assert answer["reason"]
    assert page.ask("pick", number=0)["kind"] == "state"


def test_oversized_messages_end_their_session_alone(explorer: Served, page: Browser) -> None:
    with browser(explorer) as other:
        other.socket.send(json.dumps({"kind": "read", "text": "x" * (1 << 17)}))
        with pytest.raises(ConnectionClosed) as closed:
            other.receive()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009
    assert page.ask("pick", number=0)["kind"] == "state"


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null", None])
def test_sockets_from_other_sites_are_refused(explorer: Served, origin: Any) -> None:
    with pytest.raises(InvalidStatus) as refused, connect(f"ws://{explorer.host}/socket", origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_names_that_lead_here_from_elsewhere_are_refused(explorer: Served) -> None:
    for path in ("/", "/socket"):
        connection = http.client.HTTPConnection(explorer.host, timeout=60)
        connection.request("GET", path, headers={"Host": "evil.example"})
        assert connection.getresponse().status == 403


def test_two_sessions_do_not_disturb_each_other(explorer: Served, page: Browser) -> None:
    with browser(explorer) as other:
        assert other.ask("choose", name="2PFR")["mechanism"]["name"] == "2PFR"
        x, y = chosen(page.greeting["state"])["pose"]
        mine = page.ask("drag", place=[x + 0.02, y])
        theirs = other.ask("pick", number=0)
        assert chosen(mine)["pose"][0] == pytest.approx(x + 0.02, abs=1e-4)
        assert theirs["inputs"] == list(pcm_gym.get_mechanism("2PFR").home_inputs or ())


def test_a_lengthy_search_does_not_hold_up_drags(explorer: Served, page: Browser) -> None:
    """Of the same session, or of another one."""
    with browser(explorer) as other:
        other.socket.send(json.dumps({"kind": "diagram", "along": "load", "axis": 1, "id": 7}))
        x, y = chosen(page.greeting["state"])["pose"]
        for step in range(5):
            assert page.ask("drag", place=[x + 0.005 * step, y])["kind"] == "state"
        answers = [other.ask("drag", place=[x, y - 0.01]), other.receive()]
        assert {answer["kind"] for answer in answers} == {"state", "diagram"}
        assert next(answer["answers"] for answer in answers if answer["kind"] == "diagram") == 7


def test_of_many_drags_that_wait_the_last_is_answered(page: Browser) -> None:
    x, y = chosen(page.greeting["state"])["pose"]
    for number in range(1, 41):
        page.socket.send(json.dumps({"kind": "drag", "id": number, "place": [x + 0.001 * number, y]}))
    answered: list[int] = []
    while not answered or answered[-1] < 40:
        state = page.receive()
        answered.append(state["answers"])
    assert answered == sorted(answered)
    assert chosen(state)["pose"][0] == pytest.approx(x + 0.04, abs=1e-4)


def test_random_interactions_leave_a_sound_session(page: Browser) -> None:
    rng = np.random.default_rng(3)
    state = page.greeting["state"]
    for _ in range(60):
        kind = rng.choice(["drag", "drive", "load", "pick", "release"])
        count = len(state["equilibria"])
        content: dict[str, Any] = {
            "drag": {"place": rng.uniform(-1.5, 1.5, 2).tolist()},
            "drive": {"inputs": rng.uniform(-3.0, 3.0, 2).tolist()},
            "load": {"load": rng.uniform(-0.5, 0.5, 2).tolist()},
            "pick": {"number": int(rng.integers(count))},
            "release": {},
        }[str(kind)]
        answer = page.ask(str(kind), **content)
        assert answer["kind"] == "state" or (answer["kind"] == "refused" and kind in ("release", "drag"))
        state = answer if answer["kind"] == "state" else state
        assert 0 <= state["number"] < len(state["equilibria"])
        assert all(math.isfinite(value) for value in chosen(state)["pose"])
