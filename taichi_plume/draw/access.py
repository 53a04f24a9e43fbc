"""Access to the page: from this machine, from the page's own address, and only with the token of its URL.

Every request is judged before any handler sees it, the page's as that of its WebSocket and its scripts. Host is checked
against DNS rebinding, Origin against requests of foreign pages (cross-site WebSocket hijacking). The token of the URL
becomes a cookie that scripts cannot read and that foreign pages do not send.
"""

import hmac
import re
from http.cookies import CookieError, SimpleCookie
from typing import Any

from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform, RequestHandler

NAMES = ("127.0.0.1", "localhost")
POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self'{sockets}; frame-src 'self' http://127.0.0.1:*; "
    "frame-ancestors 'self'; form-action 'self'; base-uri 'none'; object-src 'none'"
)
"""Content security policy: browsers load nothing for the page from elsewhere, and show it in no foreign frame."""
REPORTS = "default-src data:; style-src 'unsafe-inline'; frame-ancestors 'self'; sandbox allow-popups"
"""Policy of the reports of runs, which may be of others: no script, and nothing of the page within reach."""


class Access:
    """Judge of requests. port: of the server; token: secret in the page's URL."""

    def __init__(self, port: int, token: str):
        self.token = token
        self.hosts = {f"{name}:{port}" for name in NAMES}
        self.cookie = f"taichi_plume_draw_{port}"  # cookies do not distinguish ports
        sockets = "".join(f" ws://{host}" for host in sorted(self.hosts))
        self.policy = POLICY.format(sockets=sockets)

    def refusal(self, request: HTTPServerRequest) -> str:
        """Return why a request is refused; "" if it is not."""
        host = request.headers.get_list("Host")
        if len(host) != 1 or host[0] not in self.hosts:
            return "this page is served under 127.0.0.1 only"
        upgrade = "upgrade" in request.headers.get("Connection", "").lower()
        origins = request.headers.get_list("Origin")
        is_link = request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        foreign = (upgrade and not origins) or any(origin != f"http://{host[0]}" for origin in origins)
        if foreign or (is_link and not self._with_token(request)):
            return "requests of other pages are refused"
        entitled = self._with_cookie(request) or self._with_pass(request)
        if entitled or (self._with_token(request) and not upgrade):
            return ""
        return "the address lacks its token: use the one that `taichi-plume draw` printed"

    def enters(self, request: HTTPServerRequest) -> bool:
        """Return whether a request brings the token in its URL, to be exchanged for the cookie."""
        return request.method == "GET" and request.path == "/" and self._with_token(request)

    def pass_to(self, path: str) -> str:
        """Return another address of one file, which needs no cookie: rerun's viewer fetches recordings without."""
        digest = hmac.new(self.token.encode(), path.encode("utf-8", "surrogatepass"), "sha256").hexdigest()
        return f"/pass/{digest}{path}"

    def _with_pass(self, request: HTTPServerRequest) -> bool:
        file = re.sub(r"^/pass/[^/]*", "", request.path)
        return request.method == "GET" and file != request.path and _same(request.path, self.pass_to(file))

    def _with_token(self, request: HTTPServerRequest) -> bool:
        given = request.query_arguments.get("token", [])
        return len(given) == 1 and _same(given[0], self.token)

    def _with_cookie(self, request: HTTPServerRequest) -> bool:
        try:
            cookies = SimpleCookie(request.headers.get("Cookie", ""))
        except CookieError:
            return False
        given = cookies.get(self.cookie)
        return given is not None and _same(given.value, self.token)


def _same(given: str | bytes, secret: str) -> bool:
    """Compare a foreign text with a secret, in a time that does not depend on where they differ."""
    content = given.encode("utf-8", "surrogatepass") if isinstance(given, str) else given
    return hmac.compare_digest(content, secret.encode())


class Answer(RequestHandler):
    """Refusal of a request, or exchange of the token for a cookie."""

    def initialize(self, access: Access) -> None:
        self.access = access

    def prepare(self) -> None:
        reason = self.access.refusal(self.request)
        if reason:
            self.set_status(403)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"403: {reason}\n")
            return
        options: dict[str, Any] = {"httponly": True, "samesite": "Strict", "path": "/", "expires_days": None}
        self.set_cookie(self.access.cookie, self.access.token, **options)
        self.redirect("/", status=303)


class Protection(OutputTransform):
    """Transform of tornado that adds the protecting headers to every answer."""

    def __init__(self, access: Access, request: HTTPServerRequest):
        self.access = access

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        headers.setdefault("Content-Security-Policy", self.access.policy)
        headers["Referrer-Policy"] = "no-referrer"
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return status_code, headers, chunk
