"""The page of a lift in a real browser: what it computes itself is what the library computes, and a push can be dragged."""

from itertools import product

import numpy as np
import pytest
from accessibility import WIDTHS, fits, serious

from lumbar.interface.lift_page import lift_page
from lumbar.lifting.stability.funnel import monte_carlo_check
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.funnel.monte_carlo_check import preimage, simulate
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import LiftStates, headline
from lumbar.lifting.stability.model.torque_limits import reference_of, torque_range
from lumbar.settings.lifting import StabilitySettings

pytestmark = pytest.mark.nightly

SETTINGS = StabilitySettings()
PUSHES = np.array([[0.05, 0.4], [-0.3, 0.2], [0.0, -2.0], [1.2, 3.0]]).T
"""From inside every funnel to far outside; the last are limited by the torque."""


@pytest.fixture(scope="module")
def page_file(saved_lift, tmp_path_factory):
    path = tmp_path_factory.mktemp("lift") / "lift.html"
    lift_page(saved_lift[0], settings=SETTINGS, source_label="synthetic twin").save(path)
    return path.as_uri()


@pytest.fixture
def page(new_page, page_file):
    return new_page(page_file, viewport={"width": 1280, "height": 900})


@pytest.fixture(scope="module")
def trajectories(saved_lift):
    lift = lift_page(saved_lift[0]).lift
    states = LiftStates(lift.states, lift.facts)
    return states.trajectories(headline(SETTINGS, lift.facts))[0]


def test_body_is_on_the_first_screen_of_a_phone(new_page, page_file):
    phone = new_page(page_file, viewport={"width": 390, "height": 800})
    assert phone.locator("#picture-side").bounding_box()["y"] < 500


def simulate_limited(loops, lowest, highest):
    """Yield the errors of all pushes at every knot with the torque limited: Eq. 4.1 less its reference, Runge–Kutta."""
    pendulums, reference = loops.pendulums, reference_of(loops.pendulums).torque[:, 0]
    inertia, gravity = pendulums.inertia[0], pendulums.gravity_torque[0]
    path, gains, step = pendulums.angle[:, 0], loops.gains[:, 0], loops.step[0]

    def rate(point, state):
        torque = np.clip(reference[point] - gains[point] @ state, lowest, highest)
        weight = gravity * (np.sin(path[point] + state[0]) - np.sin(path[point]))
        drag = pendulums.damping * state[1]
        return np.stack([state[1], (torque - reference[point] - weight - drag) / inertia])

    state = PUSHES
    yield state
    for point in range(0, len(path) - 1, 2):
        first = rate(point, state)
        second = rate(point + 1, state + step / 2 * first)
        third = rate(point + 1, state + step / 2 * second)
        fourth = rate(point + 2, state + step * third)
        state = state + step / 6 * (first + 2 * second + 2 * third + fourth)
        yield state


def test_push_agrees_with_the_simulation_of_the_library(page, trajectories, monkeypatch):
    monkeypatch.setattr(monte_carlo_check, "MAX_STRIDE", 1)  # a step from knot to knot, as in the page
    assert len(trajectories) == 6
    for item, limited in product(trajectories, (False, True)):
        loops = close_loops([item], SETTINGS.pendulum.sign, SETTINGS)
        followed_in_page = np.array(
            [
                page.evaluate(
                    "([key, state, limits]) => window.lumbarLift.follow(key, 0, state, limits)",
                    [f"{item.com}/{item.plane}", list(push), limited],
                )
                for push in PUSHES.T
            ]
        )
        assert followed_in_page.shape == (4, SETTINGS.knots, 2)
        if limited:
            followed = enumerate(simulate_limited(loops, *torque_range(item, SETTINGS)))
        else:
            followed = ((knot, state[:, 0]) for knot, state in simulate(loops, PUSHES[:, None, :]))
        for knot, state in followed:
            assert pytest.approx(state, rel=1e-7, abs=1e-7) == followed_in_page[:, knot].T


def test_simulated_outline_is_the_goal_set_followed_backward(page, trajectories):
    item = trajectories[3]
    loops = close_loops([item], SETTINGS.pendulum.sign, SETTINGS)
    outlines = np.array(page.evaluate(f"window.lumbarLift.reached('{item.com}/{item.plane}', false, 60)"))
    edge = outlines[-1].T[:, None, :]
    goal = exact_funnels(loops, SETTINGS.goal_level).level[-1, 0]
    s11, s12, s22 = loops.cost[-1, 0]
    assert s11 * edge[0] ** 2 + 2 * s12 * edge[0] * edge[1] + s22 * edge[1] ** 2 == pytest.approx(goal)
    assert pytest.approx(preimage(loops, edge)[:, 0], rel=1e-5) == outlines[0].T


def text(page, name: str) -> str:
    return page.locator(f"#{name}").inner_text()


def test_a_push_can_be_dragged_and_typed(page):
    assert text(page, "told-certified").startswith("inside the funnel")
    assert "does not leave the funnel, and ends in the goal set" in text(page, "told-simulated")
    before = page.locator("#push-angle").input_value()
    page.locator("#picture-plane").hover()  # in sight, at rest and taking the pointer
    page.drawn()
    box = page.locator("#picture-plane canvas").first.bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.45 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.1 * box["width"], y - 0.1 * box["height"], steps=2)
    page.wait_for_function("(old) => document.getElementById('push-angle').value !== old", arg=before)
    page.mouse.move(x + 0.3 * box["width"], y - 0.3 * box["height"], steps=2)
    page.mouse.up()
    page.wait_for_function("document.getElementById('told-certified').textContent.startsWith('outside')")
    assert "It may return all the same" in text(page, "told-certified")
    dragged = float(page.locator("#push-angle").input_value())
    assert dragged > 0.3
    page.locator("#push-velocity").fill("0")
    page.locator("#push-angle").focus()
    page.locator("#push-angle").fill("0.02")
    page.keyboard.press("ArrowUp")
    assert "0.03 rad and 0 rad/s off the trajectory" in text(page, "told-push")
    assert text(page, "told-certified").startswith("inside")


def test_limits_of_the_torque_let_a_pushed_pendulum_fall(page):
    page.locator("#push-angle").fill("0.3")
    page.locator("#push-velocity").fill("1.5")
    assert "ends in the goal set" in text(page, "told-simulated")
    page.get_by_label("limit the torque").check()
    assert "does not end in the goal set" in text(page, "told-simulated")
    assert "at a limit for" in text(page, "told-torque")


def test_time_is_gone_through_by_keyboard_and_everything_follows(page):
    for name in ("release", "start of deposit"):
        page.get_by_role("button", name=name).click()
    before = page.evaluate("Bokeh.documents[0].get_model_by_name('side:centres').data.y.slice()")
    page.locator("#time").focus()
    for _ in range(60):
        page.keyboard.press("ArrowRight")
    assert "6.42 s · deposit" in text(page, "now")
    after = page.evaluate("Bokeh.documents[0].get_model_by_name('side:centres').data.y.slice()")
    assert after[-1] < before[-1]  # the box goes down
    page.locator("#picture-plane").scroll_into_view_if_needed()  # what is out of sight is drawn when it comes
    page.wait_for_function("document.getElementById('section').textContent.includes('at 6.42 s')")
    assert all(url.startswith(("file:", "data:", "blob:")) for url in page.asked)


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_page(new_page, page_file, scheme, width):
    page = new_page(page_file, viewport={"width": width, "height": 900}, color_scheme=scheme)
    assert serious(page) == []
    fits(page, *WIDTHS, 1920)
