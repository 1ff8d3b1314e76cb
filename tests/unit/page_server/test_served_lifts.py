"""Lifts that are served: each at its address, to this machine's names alone."""

from __future__ import annotations

import asyncio
import http.client
import threading

import pytest

from lumbar.page_server.served_lifts import ServedLift, add_lifts
from lumbar.page_server.server import HOST, new_server
from lumbar.settings.stability import StabilitySettings


@pytest.fixture
def port(saved_lift, tmp_path):
    (tmp_path / "a lift").symlink_to(saved_lift[0])
    (tmp_path / "broken").mkdir()
    lifts = [ServedLift(path, StabilitySettings()) for path in (tmp_path / "a lift", tmp_path / "broken")]
    ready, running = threading.Event(), []

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        server = new_server([], 0)
        add_lifts(server, lifts)
        server.start()
        running.append(server)
        ready.set()
        server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert ready.wait(30)
    yield running[0].port
    running[0].io_loop.add_callback(running[0].io_loop.stop)
    thread.join(10)


def got(port, path, **headers):
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_every_lift_has_its_address(port, saved_lift):
    assert got(port, "/lifts/a%20lift") == (200, saved_lift[1])
    status, words = got(port, "/lifts/broken")
    assert status == 500 and "no body.csv" in words
    assert got(port, "/lifts/another")[0] == 404
    assert got(port, "/lifts/a%20lift", Host="somewhere.example")[0] == 404
