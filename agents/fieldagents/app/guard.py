"""Who may talk to the page: a browser on this machine that has the token, and no page of another site."""

from __future__ import annotations

import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

CONTENT = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)


class Guard:
    """Lets a request through if its host, its origin and its token are right; there are no sockets."""

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        """Guard an application.

        Args:
            app: The application.
            token: What the address holds that the user opens; it becomes a cookie.
            port: Port of the page: cookies know no ports, so that its name must.
        """
        self.app, self.token, self.cookie = app, token, f"fieldgym-{port}"
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
            return
        headers = Headers(scope=scope)
        trouble = self._trouble(scope, headers)
        if trouble:
            await PlainTextResponse(trouble, status_code=403)(scope, receive, send)
            return
        if scope["path"] == "/" and self._is_token(_given(scope)):
            response = RedirectResponse("/", status_code=303)
            response.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
            await response(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    (b"content-security-policy", CONTENT.encode()),
                    (b"x-content-type-options", b"nosniff"),
                    (b"referrer-policy", b"no-referrer"),
                    (b"cache-control", b"no-store"),
                ]
            await send(message)

        await self.app(scope, receive, with_headers)

    def _trouble(self, scope: Scope, headers: Headers) -> str:
        """Why a request is refused; empty if it is not."""
        if headers.get("host", "") not in self.hosts:
            return "refused: this page answers to 127.0.0.1 and localhost alone"
        origin = headers.get("origin")
        if origin is not None and origin not in self.origins:
            return "refused: asked by the page of another site"
        if scope["method"] not in ("GET", "HEAD") and origin is None:
            return "refused: a change needs an Origin"
        try:
            kept = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        except CookieError:
            kept = None
        given = _given(scope) if scope["path"] == "/" else ""
        if self._is_token(kept.value if kept else "") or self._is_token(given):
            return ""
        return "refused: open the address that `fieldgym open` has printed, with its token"

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())


def _given(scope: Scope) -> str:
    asked: bytes = scope["query_string"]
    return parse_qs(asked.decode("latin-1")).get("token", [""])[0]
