"""Proxies and certificates of the environment, with closed ports and servers of this machine."""

from __future__ import annotations

import socket

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.server import saying
from tests.articulate.reconstruct.actors.vlm.test_gemini import REQUEST

from articulate import commands
from articulate.errors import MissingError, UsageError
from articulate.reconstruct.actors.vlm.gemini import GeminiFormat
from articulate.reconstruct.actors.vlm.network import check_network_settings, proxy_of

FAR = "http://models.example"


@pytest.fixture
def closed_port():
    """A port of this machine on which nothing listens while the test runs."""
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))
        yield reserved.getsockname()[1]


@pytest.fixture
def no_socksio(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("ALL_PROXY", "socks5://127.0.0.1:1080"),
        ("https_proxy", "socks5h://me:secret@127.0.0.1:1080"),
        ("ALL_PROXY", "socks://127.0.0.1:1080"),
        ("HTTP_PROXY", "ftp://127.0.0.1:21"),
        ("HTTPS_PROXY", "http://127.0.0.1:port"),
    ],
)
@pytest.mark.usefixtures("no_socksio")
def test_a_proxy_that_cannot_be_used_is_reported_with_its_variable(
    monkeypatch, error_line, variable, value
):
    monkeypatch.setenv(variable, value)
    line = error_line(f"{variable}={value}", check_network_settings)
    assert line.startswith(f"{variable} is ")
    assert "secret" not in line
    if "socks5" in value:
        assert 'pip install "httpx[socks]"' in line


def test_socks_with_its_package_is_accepted(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: object())
    monkeypatch.setenv("ALL_PROXY", "socks5://127.0.0.1:1080")
    check_network_settings()


def test_no_proxy_with_a_star_switches_all_proxies_off(monkeypatch):
    monkeypatch.setenv("ALL_PROXY", "socks://127.0.0.1:1080")
    monkeypatch.setenv("NO_PROXY", "*")
    check_network_settings()
    assert proxy_of(FAR) is None


def test_the_proxy_of_a_request_follows_scheme_and_exceptions(monkeypatch):
    monkeypatch.setenv("HTTP_PROXY", "127.0.0.1:3128")
    monkeypatch.setenv("ALL_PROXY", "http://127.0.0.1:8080")
    monkeypatch.setenv("NO_PROXY", "localhost,.internal")
    found = proxy_of(FAR)
    assert found is not None
    assert (found.variable, found.url.port) == ("HTTP_PROXY", 3128)
    found = proxy_of("https://models.example")
    assert found is not None
    assert found.variable == "ALL_PROXY"
    assert proxy_of("http://localhost:8000") is None
    assert proxy_of("http://host.internal") is None


@pytest.mark.parametrize("content", [None, "no certificate"])
@pytest.mark.parametrize("variable", ["SSL_CERT_FILE", "SSL_CERT_DIR"])
def test_certificates_that_cannot_be_read_are_reported_with_their_variable(
    monkeypatch, error_line, tmp_path, variable, content
):
    path = tmp_path / "certificates"
    if content is not None:
        path.write_text(content)
    monkeypatch.setenv(variable, str(path))
    line = error_line(f"{variable}, {content or 'absent'}", check_network_settings)
    assert line.startswith(f"{variable} is ")


def test_a_dead_proxy_is_reported_at_once(client, monkeypatch, gemini, closed_port):
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    monkeypatch.setenv(GeminiFormat().url_variable, FAR)
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{closed_port}")
    with pytest.raises(UsageError, match=r"HTTP_PROXY is http://127.0.0.1:.* cannot be reached"):
        gemini.generate(REQUEST)


def test_a_request_goes_through_a_proxy_that_works(serve, monkeypatch, gemini):
    server = serve(saying({"n": 3}))
    monkeypatch.setenv("HTTP_PROXY", server.url)
    monkeypatch.setenv(GeminiFormat().url_variable, FAR)
    assert gemini.generate(REQUEST).text == '{"n": 3}'
    assert server.heard[0].path.startswith(FAR)


def test_a_proxy_that_breaks_off_is_named(serve, monkeypatch, gemini):
    server = serve((200, b"<html>log in first</html>"))
    monkeypatch.setenv("HTTP_PROXY", server.url)
    monkeypatch.setenv(GeminiFormat().url_variable, FAR)
    with pytest.raises(UsageError, match="check the proxy of HTTP_PROXY"):
        gemini.generate(REQUEST)


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("ALL_PROXY", "socks5://127.0.0.1:1080"),
        ("ALL_PROXY", "socks://127.0.0.1:1080"),
        ("SSL_CERT_FILE", "/nowhere/certificates.pem"),
    ],
)
@pytest.mark.usefixtures("client", "no_socksio")
def test_make_ends_with_one_line_and_exit_2(monkeypatch, tmp_path, capsys, variable, value):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    monkeypatch.setenv(variable, value)
    text = ["--text", "a cabinet with a drawer", "--library", "cabinet:3"]
    assert commands.main(["make", *text, "--actor", "hybrid", "--out", "x", "-q"]) == 2
    err = capsys.readouterr().err.strip()
    assert err.count("\n") == 0
    assert f"{variable} is {value}" in err
    assert not (tmp_path / "x").exists()


def test_a_socks_proxy_without_its_package_is_a_missing_package(monkeypatch, no_socksio):
    monkeypatch.setenv("all_proxy", "socks5://127.0.0.1:1080")
    with pytest.raises(MissingError, match="all_proxy is socks5"):
        check_network_settings()
