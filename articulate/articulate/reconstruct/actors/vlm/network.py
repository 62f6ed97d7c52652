"""Proxies and certificates in the environment, checked before a request is sent."""

from __future__ import annotations

import importlib.util
import os
import re
import socket
import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import SplitResult, urlsplit
from urllib.request import getproxies_environment, proxy_bypass

from articulate.errors import ConfigError, MissingError, UsageError, shorten

SCHEMES = ("http", "https", "socks5", "socks5h")
"""Schemes of proxies that httpx supports."""
PORTS = {"http": 80, "https": 443, "socks5": 1080, "socks5h": 1080}
CONNECT_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class ProxySetting:
    """A proxy and the environment variable that names it."""

    variable: str
    value: str

    @property
    def url(self) -> SplitResult:
        """URL of the proxy; ``http`` without a scheme, as in httpx."""
        return urlsplit(self.value if "://" in self.value else f"http://{self.value}")

    def __str__(self) -> str:
        return f"{self.variable} is {shorten(re.sub(r'//[^/@]*@', '//', self.value))}"


def check_network_settings() -> None:
    """Check the proxies and certificate files that the environment names.

    httpx opens every proxy of the environment, also those that the request does not use.

    Raises:
        ConfigError: A proxy has an unknown scheme, or a certificate file cannot be read.
        MissingError: A SOCKS proxy needs a package that is not installed.
    """
    for setting in _proxies():
        _check_proxy(setting)
    _check_certificates()


def proxy_of(url: str) -> ProxySetting | None:
    """Return the proxy that requests to ``url`` use; None for a direct connection."""
    target = urlsplit(url)
    if proxy_bypass(target.hostname or ""):
        return None
    by_scheme = {setting.variable.lower(): setting for setting in _proxies()}
    return by_scheme.get(f"{target.scheme}_proxy") or by_scheme.get("all_proxy")


def check_connection(proxy: ProxySetting) -> None:
    """Open and close a connection to a proxy, so that a dead one is reported at once.

    Raises:
        UsageError: The proxy does not accept connections.
    """
    address = (proxy.url.hostname or "", proxy.url.port or PORTS[proxy.url.scheme])
    try:
        socket.create_connection(address, timeout=CONNECT_TIMEOUT_S).close()
    except OSError as error:
        raise UsageError(
            f"{proxy}: this proxy cannot be reached ({error.strerror or error}); "
            f"start it or unset {proxy.variable}"
        ) from None


def _proxies() -> Iterator[ProxySetting]:
    """Yield the proxy settings that httpx reads; none where ``NO_PROXY`` is ``*``."""
    proxies = getproxies_environment()
    if "*" in [host.strip() for host in proxies.get("no", "").split(",")]:
        return
    for scheme in ("http", "https", "all"):
        if proxies.get(scheme):
            lower = f"{scheme}_proxy"
            yield ProxySetting(lower if os.environ.get(lower) else lower.upper(), proxies[scheme])


def _check_proxy(proxy: ProxySetting) -> None:
    try:
        scheme, is_complete = proxy.url.scheme, bool(proxy.url.hostname)
        is_complete = is_complete and proxy.url.port != 0
    except ValueError:  # a port that is not a number, brackets without an address
        scheme, is_complete = "http", False
    if scheme not in SCHEMES:
        hint = f"known: {', '.join(SCHEMES)}"
        if scheme == "socks":  # GNOME's network settings write it
            hint = f"write {proxy.variable}=socks5://{shorten(proxy.url.netloc.rpartition('@')[2])}"
        raise ConfigError(f"{proxy}: unknown scheme {shorten(scheme)}; {hint}")
    if not is_complete:
        raise ConfigError(
            f"{proxy}: not the address of a proxy; write http://HOST:PORT or unset {proxy.variable}"
        )
    if scheme.startswith("socks") and importlib.util.find_spec("socksio") is None:
        raise MissingError(
            f"{proxy}: SOCKS proxies need a package that is not installed; "
            f'run: pip install "httpx[socks]", or unset {proxy.variable}'
        )


def _check_certificates() -> None:
    file, folder = os.environ.get("SSL_CERT_FILE"), os.environ.get("SSL_CERT_DIR")
    if file:
        reason = "no such file"
        try:
            if Path(file).is_file():
                ssl.create_default_context(cafile=file)
                reason = ""
        except ssl.SSLError:
            reason = "holds no certificates in PEM format"
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "cannot be read"
        if reason:
            raise ConfigError(
                f"SSL_CERT_FILE is {shorten(file)}: {reason}; give a file of certificates in PEM "
                "format or unset SSL_CERT_FILE"
            )
    elif folder and not Path(folder).is_dir():
        raise ConfigError(
            f"SSL_CERT_DIR is {shorten(folder)}: no such folder; give a folder of certificates or "
            "unset SSL_CERT_DIR"
        )
