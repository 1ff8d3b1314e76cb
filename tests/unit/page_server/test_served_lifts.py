"""Lifts that are served: each at its address, to this machine's names alone."""

from __future__ import annotations

from functools import partial

import pytest
from asking import ask, serving

from lumbar.page_server.served_lifts import ServedLift, add_lifts
from lumbar.page_server.server import new_server
from lumbar.settings.stability import StabilitySettings


@pytest.fixture
def get(saved_lift, tmp_path):
    (tmp_path / "a lift").symlink_to(saved_lift[0])
    (tmp_path / "broken").mkdir()

    def make():
        server = new_server([], 0)
        add_lifts(server, [ServedLift(tmp_path / name, StabilitySettings()) for name in ("a lift", "broken")])
        return server

    with serving(make) as port:
        yield partial(ask, port, "GET")


def test_every_lift_has_its_address(get, saved_lift):
    status, _, page = get("/lifts/a%20lift")
    assert (status, page) == (200, saved_lift[1])
    status, _, words = get("/lifts/broken")
    assert status == 500 and "no body.csv" in words
    assert get("/lifts/another")[0] == 404
    assert get("/lifts/a%20lift", Host="somewhere.example")[0] == 404
