#!/usr/bin/env python3
"""Attacks a rigd from outside: every attack must be refused, and the rig must answer afterwards.

    tests/service/attack.py target/release/rigd

It starts a daemon of its own on the simulated bench, with tokens. Standard library only.
"""

import concurrent.futures
import json
import re
import resource
import socket
import ssl
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

RIGD = Path(sys.argv[1]).resolve()
ROOT = Path(__file__).resolve().parents[2]
DATA = tempfile.TemporaryDirectory()
failures = []


def run(*args):
    done = subprocess.run([RIGD, *args, "--data", DATA.name], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def ask(method, path, token=None, body=None, headers=None, timeout=15):
    request = urllib.request.Request(f"http://{ADDRESS}{path}", data=body, method=method)
    for name, value in (headers or {}).items():
        request.add_header(name, value)
    if token:
        request.add_header("Authorization", f"Bearer {token}")
    try:
        with urllib.request.urlopen(request, timeout=timeout) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def raw(text, timeout=15):
    """Sends bytes as they are, and reads to the end."""
    with socket.create_connection((HOST, PORT), timeout=timeout) as client:
        got = b""
        try:
            client.sendall(text)
            while part := client.recv(65536):
                got += part
        except OSError:
            pass
        return got


def serve(*args):
    """A daemon of its own, and its host and port."""
    log = open(Path(DATA.name) / "log", "a+")
    begin = Path(log.name).stat().st_size
    daemon = subprocess.Popen(
        [RIGD, "serve", "config/protocols/smoke.toml", "--data", DATA.name, "--listen", "127.0.0.1:0", *args],
        cwd=ROOT, stderr=log, stdout=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 30
    while not (found := re.search(r"https?://([0-9.]+):(\d+)/", Path(log.name).read_text()[begin:])):
        assert time.monotonic() < deadline and daemon.poll() is None, Path(log.name).read_text()
        time.sleep(0.05)
    return daemon, log, found[1], int(found[2])


def expect(what, got, *allowed):
    if got in allowed:
        return
    failures.append(f"{what}: {got}, and {allowed} was expected")


def still_well(after):
    began = time.monotonic()
    status, body = ask("POST", "/api/v1/stop", VIEW)
    took = time.monotonic() - began
    expect(f"a stop after {after}", status, 200)
    if took > 2:
        failures.append(f"a stop after {after} took {took:.1f} s")


def status_of(answer):
    return int(answer.split(b" ", 2)[1]) if answer.startswith(b"HTTP/1.1 ") else 0


OPERATE, VIEW = run("token", "new", "ada", "--role", "operate"), run("token", "new", "eve", "--role", "view")
daemon, log, HOST, PORT = serve()
try:
    deadline = time.monotonic() + 30
    ADDRESS = f"{HOST}:{PORT}"
    while ask("GET", "/readyz")[0] != 200:
        assert time.monotonic() < deadline, "not ready"
        time.sleep(0.05)

    paths = json.loads(ask("GET", "/openapi.json", VIEW)[1])["paths"]
    # Without a token, and with a token that only views.
    for path, item in paths.items():
        path = path.replace("{id}", "latest").replace("{number}", "1")
        for method in item:
            method = method.upper()
            expect(f"{method} {path} without a token", ask(method, path)[0], 401)
            harmless = method == "GET" or path.split("/")[-1] in ("stop", "check", "session", "links")
            if not harmless:
                expect(f"{method} {path} with view", ask(method, path, VIEW)[0], 403)
    still_well("requests without a right")

    # Rebinding and forgery.
    for host in ("evil.example", f"evil.example:{PORT}", "169.254.169.254", "127.0.0.1.evil.example"):
        head = f"POST /api/v1/stop HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {OPERATE}\r\nConnection: close\r\n\r\n"
        expect(f"Host {host}", status_of(raw(head.encode())), 421)
    for name, value in (("Origin", "http://evil.example"), ("Origin", "null"), ("Sec-Fetch-Site", "cross-site")):
        expect(f"{name}: {value}", ask("POST", "/api/v1/runs", OPERATE, headers={name: value})[0], 403)
    form = {"Content-Type": "text/plain"}
    expect("a form of a page", ask("POST", "/api/v1/sweeps", OPERATE, b'{"min_hz":1,"max_hz":2}', form)[0], 415)

    # A link works once, and a cookie is no token for commands of other pages.
    link = json.loads(ask("POST", "/api/v1/links", VIEW)[1])["path"]
    head = f"GET {link} HTTP/1.1\r\nHost: localhost:{PORT}\r\nConnection: close\r\n\r\n".encode()
    first, second = raw(head), raw(head)
    expect("a link", status_of(first), 303)
    expect("the same link again", status_of(second), 410)
    cookie = re.search(rb"set-cookie: ([^;]+)", first)[1].decode()
    expect("a cookie without Origin", ask("POST", "/api/v1/session", headers={"Cookie": cookie})[0], 403)

    # One client cannot end the cookies of the others, however many it asks for.
    for _ in range(300):
        ask("POST", "/api/v1/session", VIEW)
    first = raw(f"POST /api/v1/session HTTP/1.1\r\nHost: localhost:{PORT}\r\nAuthorization: Bearer {OPERATE}\r\n"
                "Connection: close\r\n\r\n".encode())
    cookie = re.search(rb"set-cookie: ([^;]+)", first)[1].decode()
    for _ in range(300):
        ask("POST", "/api/v1/session", VIEW)
    head = f"GET /api/v1/rig HTTP/1.1\r\nHost: localhost:{PORT}\r\nCookie: {cookie}\r\nConnection: close\r\n\r\n"
    expect("a cookie after those of another client", status_of(raw(head.encode())), 200)

    # A note that gives orders to a terminal, and a line that looks like one of the list.
    note = {"note": "a\x1b]0;taken over\x07\x9b2J\u202e\nentry 9: forged"}
    expect("a note", ask("POST", "/api/v1/queue", OPERATE, json.dumps(note).encode(), {"Content-Type": "application/json"})[0], 201)
    shown = run("queue", "list")
    if any(letter in shown for letter in "\x1b\x07\x9b\u202e") or "\nentry 9" in shown:
        failures.append(f"a note gives orders to the terminal: {shown!r}")

    # Requests within the body of another.
    inner = f"GET /api/v1/session HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {OPERATE}\r\n\r\n"
    begin = f"POST /api/v1/protocols/check HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {VIEW}\r\n"
    for lengths in ("Content-Length: 4\r\nTransfer-Encoding: chunked", "Transfer-Encoding: chunked\r\nContent-Length: 4",
                    "Content-Length: 0\r\nContent-Length: 5", "Content-Length: 0, 0", "Content-Length: +5",
                    "Transfer-Encoding: xchunked", "Transfer-Encoding: chunked, identity", "Content-Length : 0"):
        answer = raw(f"{begin}{lengths}\r\n\r\n0\r\n\r\n{inner}".encode())
        if b'"name"' in answer:
            failures.append(f"a request within another was answered: {lengths!r}")

    # Paths.
    for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/page.js/../../Cargo.toml", "//etc/passwd",
                 "/api/v1/runs/..%2f..%2ftokens.json/report", "/api/v1/runs/%00/report", "/open/", "/open/x/y"):
        answer = raw(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {VIEW}\r\nConnection: close\r\n\r\n".encode())
        expect(f"GET {path}", status_of(answer), 400, 404, 410)

    # Bodies and heads that are malformed or too large.
    json_type = {"Content-Type": "application/json"}
    for body in (b"", b"{", b"[" * 100_000, b"\xff\xfe", b'{"min_hz": 1e999, "max_hz": 2}', b"null", b"0" * 300_000):
        expect(f"a body {body[:20]!r}", ask("POST", "/api/v1/sweeps", OPERATE, body, json_type)[0], 400, 413, 415, 422)
    toml = {"Content-Type": "application/toml"}
    for body in (b"a" * 200_000, b"[" * 100_000, b"x = " + b"[" * 50_000, b"a.b.c.d.e = 1\n" * 10_000):
        expect(f"a protocol {body[:20]!r}", ask("POST", "/api/v1/protocols/check", OPERATE, body, toml)[0], 400, 413, 422)
    for head in (b"GET / HTTP/9.9\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00", b"GET /\r\n\r\n",
                 b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n",
                 b"POST /api/v1/stop HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
                 b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 40_000 + b"\r\n\r\n"):
        expect(f"a head {head[:40]!r}", status_of(raw(head)), 0, 400, 401, 408, 431)
    still_well("malformed requests")

    # Guesses.
    codes = [ask("GET", "/api/v1/rig", f"rigd_{number:064x}")[0] for number in range(30)]
    expect("the first guess", codes[0], 401)
    expect("the thirtieth guess", codes[-1], 429)
    still_well("guesses")

    # Drips: heads and bodies that do not come.
    drips = []
    for _ in range(100):
        client = socket.create_connection((HOST, PORT))
        client.sendall(b"GET / HTTP/1.1\r\nHo")
        drips.append(client)
    still_well("100 heads that do not come")
    # Streams that are not read.
    streams = []
    for _ in range(100):
        client = socket.create_connection((HOST, PORT))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(f"GET /api/v1/events?live=true HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {VIEW}\r\n\r\n".encode())
        streams.append(client)
    still_well("100 event streams that are not read")
    for client in drips + streams:
        client.close()

    # A flood of short requests by 64 clients.
    def flood(_):
        return [ask("GET", "/api/v1/rig", VIEW, timeout=30)[0] for _ in range(20)]

    with concurrent.futures.ThreadPoolExecutor(64) as pool:
        codes = [code for part in pool.map(flood, range(64)) for code in part]
    if bad := [code for code in codes if code not in (200, 503)]:
        failures.append(f"a flood was answered with {sorted(set(bad))}")
    still_well("a flood")
    for token in (OPERATE, VIEW):
        for file in Path(DATA.name).iterdir():
            if file.is_file() and file.name != "log" and token.encode() in file.read_bytes():
                failures.append(f"{file.name} has a token")
    if OPERATE in Path(log.name).read_text():
        failures.append("the log has a token")
finally:
    daemon.terminate()
    code = daemon.wait(timeout=60)
expect("the exit code of the daemon", code, 0)

# Clients that connect to a port of TLS and say nothing, on all ordinary connections and all that are kept for a stop.
daemon, log, HOST, PORT = serve("--tls")
try:
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    silent = [socket.create_connection((HOST, PORT)) for _ in range(min(1230, most - 64))]
    trusted = ssl.create_default_context(cafile=f"{DATA.name}/tls-certificate.pem")
    began = time.monotonic()
    with socket.create_connection((HOST, PORT), timeout=15) as client, trusted.wrap_socket(client, server_hostname=HOST) as tls:
        tls.sendall(f"POST /api/v1/stop HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {VIEW}\r\n"
                    "Content-Length: 0\r\n\r\n".encode())
        expect("a stop among silent clients of TLS", status_of(tls.recv(65536)), 200)
    if (took := time.monotonic() - began) > 3:
        failures.append(f"a stop among silent clients of TLS took {took:.1f} s")
    for client in silent:
        client.close()
    # What is no TLS, and what is nearly TLS.
    for noise in (b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\xff\xff" + b"\0" * 70_000, b"\x16\x03\x01\x00\x05\x01\x00\x00\x01\x00"):
        if raw(noise).startswith(b"HTTP/"):
            failures.append(f"the port of TLS answered {noise[:20]!r} in HTTP")
finally:
    daemon.terminate()
    code = daemon.wait(timeout=60)
expect("the exit code of the daemon with TLS", code, 0)
for failure in failures:
    print("FAILED:", failure)
if not failures:
    print("every attack was refused, and a stop was answered within 2 s after each")
sys.exit(bool(failures))
