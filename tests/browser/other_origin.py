"""A page of another origin, which tries to command and to read a console in the same browser."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from tests.browser.headless_browser import Browser

ATTACK = """<!doctype html><title>busy</title><script>
const target = "TARGET", results = {};
const tries = {
  simple: () => fetch(target + "/command", {method: "POST", mode: "no-cors", body: 'BODY'})
    .then(() => "sent, unread"),
  command: () => fetch(target + "/command", {method: "POST", body: 'BODY',
    headers: {"Content-Type": "application/json", "Authorization": "Bearer TOKEN"}}).then((r) => r.status),
  page: () => fetch(target + "/").then((r) => r.text()),
  events: () => new Promise((done) => {
    const source = new EventSource(target + "/events");
    source.onmessage = source.onopen = () => done("open");
    source.onerror = () => done("error");
  }),
};
Promise.all(Object.entries(tries).map(async ([name, attempt]) => {
  results[name] = await attempt().catch((error) => "error");
})).then(() => { document.title = JSON.stringify(results); });
</script>"""


def assert_refused_from_another_origin(browser: Browser, port: int, token: str, command: str) -> None:
    """Open such a page, which even has the token; each of its attempts must fail."""
    target, body = f"http://127.0.0.1:{port}", json.dumps({"command": command})
    page = ATTACK.replace("TARGET", target).replace("TOKEN", token).replace("BODY", body)

    class Attacker(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page.encode())

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Attacker)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        browser.open(f"http://localhost:{server.server_address[1]}/")
        browser.until(lambda: browser.run("return document.title") != "busy", "no result")
    finally:
        server.shutdown()
        server.server_close()
    results = json.loads(browser.run("return document.title"))
    assert results == {"simple": "error", "command": "error", "page": "error", "events": "error"}
