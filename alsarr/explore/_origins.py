"""Whose requests the server answers: those of its own pages."""

from collections.abc import Collection

from tornado.httputil import HTTPServerRequest
from tornado.routing import AnyMatches, Matcher, Rule, RuleRouter
from tornado.web import Application, ErrorHandler


def own_pages_alone(pages: Application, hosts: Collection[str]) -> RuleRouter:
    """Requests of its own pages go to `pages`, all others are forbidden (403).

    A page elsewhere may give its own name this machine's address, and its browser
    then takes the server for a part of it. The names that it sends tell.

    **Arguments:** `hosts`: what the server is called, as name:port.
    """
    forbidden = Application([(".*", ErrorHandler, {"status_code": 403})])
    own = Rule(_FromHere(hosts), pages)
    return RuleRouter([own, Rule(AnyMatches(), forbidden)])


class _FromHere(Matcher):
    """Of requests that name one of the hosts, and no page that came from another."""

    def __init__(self, hosts: Collection[str]):
        self._hosts = hosts

    def match(self, request: HTTPServerRequest) -> dict[str, str] | None:
        # Only browsers send where a page came from, and not for every request.
        origin = request.headers.get("Origin", f"http://{request.host}")
        scheme, _, of_page = origin.partition("://")
        own = self._known(request.host) and scheme == "http" and self._known(of_page)
        return {} if own else None

    def _known(self, host: str) -> bool:
        # The port is left out where it is that of the scheme.
        return (host if ":" in host else f"{host}:80").lower() in self._hosts
