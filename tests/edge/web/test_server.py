"""The console's server over real HTTP: who may look, who may command, and the stream of events."""

from __future__ import annotations

import http.client
import json
import socket
from contextlib import closing, contextmanager

import pytest

from palpate_edge.common.errors import ConfigError, PalpateError
from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import addresses, page_files
from palpate_edge.web.server import LONGEST_BODY, MOST_LISTENERS, ConsoleServer

TOKEN = "t" * 43
JSON = {"Content-Type": "application/json", "Authorization": f"Bearer {TOKEN}"}


def run_command(body):
    value = json.loads(body)
    if value["command"] == "refused":
        raise PalpateError("not now: wait")
    return f"did {value['command']}"


@pytest.fixture
def broadcast():
    return Broadcast()


@pytest.fixture
def port(broadcast, tmp_path):
    (tmp_path / "some.html").write_text("<!doctype html><title>some</title>")
    (tmp_path / "some.js").write_text("// nothing")
    server = ConsoleServer(0, TOKEN, page_files(tmp_path, "some"), broadcast, run_command)
    with server.serving():
        yield server.port


def ask(port, method="POST", path="/command", body=b'{"command": "tare"}', **headers):
    """Status and JSON of one request."""
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=30)) as connection:
        connection.request(method, path, body, {**(JSON if method == "POST" else {}), **sent})
        response = connection.getresponse()
        data = response.read()
        return response.status, json.loads(data) if data.startswith(b"{") else data


@contextmanager
def stream(port):
    """Lines of the stream of events."""
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=30)) as connection:
        connection.request("GET", "/events")
        response = connection.getresponse()
        assert response.status == 200
        yield response
        connection.sock.shutdown(socket.SHUT_RDWR) if connection.sock else None


def next_event(response):
    kind = ""
    while not kind:
        line = response.readline().decode().strip()
        kind = line.removeprefix("event: ") if line.startswith("event: ") else ""
    return kind, json.loads(response.readline().decode().removeprefix("data: "))


def test_a_command_with_the_token_is_carried_out_or_refused_with_the_reason(port):
    assert ask(port) == (200, {"text": "did tare"})
    assert ask(port, Host="localhost", Origin="http://localhost") == (200, {"text": "did tare"})
    forwarded = {"Host": "localhost:9000", "Origin": "http://localhost:9000"}  # ssh -L 9000:...
    assert ask(port, **forwarded, Sec_Fetch_Site="same-origin") == (200, {"text": "did tare"})
    assert ask(port, body=b'{"command": "refused"}') == (409, {"refused": "not now: wait"})


@pytest.mark.parametrize(
    "authorization", ["", "Bearer ", "Bearer x", f"Basic {TOKEN}", f"Bearer {TOKEN}x", "Bearer \xff"]
)
def test_a_watcher_without_the_token_is_refused(port, authorization):
    status, answer = ask(port, Authorization=authorization)
    assert status == 401 and "watching only" in answer["refused"]


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:8470"},
        {"Host": "127.0.0.1.evil.example"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "what", [("POST", "/command"), ("GET", "/events"), ("GET", "/some.js"), ("GET", "/")]
)
def test_another_host_or_origin_is_refused_with_the_token_too(port, headers, what):
    status, answer = ask(port, *what, **headers)
    assert status == 403 and "refused" in answer


def test_a_link_from_another_site_may_open_the_page_and_no_frame_may_hold_it(port):
    status, page = ask(port, "GET", "/", None, Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="document")
    assert status == 200 and b"<title>some</title>" in page
    assert ask(port, "GET", "/", None, Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="iframe")[0] == 403
    with closing(http.client.HTTPConnection("127.0.0.1", port)) as connection:
        connection.request("GET", "/")
        response = connection.getresponse()
        assert "frame-ancestors 'none'" in response.headers["Content-Security-Policy"]
        assert "default-src 'none'" in response.headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in response.headers


@pytest.mark.parametrize(
    ("path", "headers", "body", "status"),
    [
        ("/other", {}, b"{}", 404),
        ("/command", {"Content_Type": "text/plain"}, b"{}", 415),
        ("/command", {}, b"x" * (LONGEST_BODY + 1), 400),
        ("/command", {"Content_Length": "-1"}, None, 400),
        ("/command", {"Content_Length": "\u0661"}, None, 400),
    ],
)
def test_odd_requests_are_refused(port, path, headers, body, status):
    headers = {name: value.encode() if not value.isascii() else value for name, value in headers.items()}
    assert ask(port, path=path, body=body, **headers)[0] == status


def test_files_outside_of_the_pages_are_not_served(port):
    for path in ("/../server.py", "/console.css/../../server.py", "/%2e%2e/server.py", "/some.html"):
        assert ask(port, "GET", path, None)[0] == 404


def test_the_stream_begins_with_the_newest_events_and_has_beats(port, broadcast):
    broadcast.publish("frame", {"number": 1})
    broadcast.publish("frame", {"number": 2})
    broadcast.publish("state", {"connected": True})
    with stream(port) as response:
        assert next_event(response) == ("frame", {"number": 2})
        assert next_event(response) == ("state", {"connected": True})
        assert next_event(response) == ("beat", {})
        broadcast.publish("frame", {"number": 3})
        while (event := next_event(response))[0] == "beat":
            pass
        assert event == ("frame", {"number": 3})


def test_a_slow_listener_skips_events_and_the_publisher_never_waits(broadcast):
    seen = []
    broadcast.on_listeners = seen.append
    with broadcast.listen() as listener:
        for number in range(1000):
            broadcast.publish("frame", number)
        assert listener.next(0.0) == [("frame", b"999")]
        assert listener.next(0.0) == []
        with broadcast.listen() as another:
            assert another.next(0.0) == [("frame", b"999")]
    assert seen == [True, False]


def test_more_listeners_than_allowed_are_refused(port, broadcast):
    broadcast.listeners = MOST_LISTENERS
    status, answer = ask(port, "GET", "/events", None)
    assert status == 503 and "close one" in answer["refused"]


def test_a_port_in_use_is_an_error_with_the_way_out(port, broadcast):
    with pytest.raises(ConfigError, match="give another --port"):
        ConsoleServer(port, TOKEN, {}, broadcast, run_command)


def test_the_printed_addresses_have_the_token_and_the_way_over_ssh():
    text = "\n".join(addresses(8470, TOKEN))
    assert f"http://127.0.0.1:8470/#token={TOKEN}\n" in text
    assert "ssh -L 8470:127.0.0.1:8470" in text
