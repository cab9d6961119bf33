"""A person's session at the gateway, by its REST interface."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from http.cookiejar import CookieJar
from typing import Any

from skiros2_common.core.errors import Refused, TimedOut

#: The time for an answer (s).
TIMEOUT = 10.0


class LoggedOut(Refused):
    """The gateway knows no session, or it has ended."""


class Gateway:
    """Methods block and raise `SkirosError`: jobs call them. The cookie is kept in memory only.

    :param address: such as `http://127.0.0.1:8765`.
    """

    def __init__(self, address: str) -> None:
        self._address = address.rstrip("/")
        # no proxy: it would see the password
        cookies = urllib.request.HTTPCookieProcessor(CookieJar())
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), cookies)

    def log_in(self, user: str, secret: str) -> tuple[str, str]:
        """Starts a session. Returns the user's name and role.

        :param user: "" if `secret` is a token instead of a password.
        """
        answer = self._request("/session", {"user": user, "password": secret} if user else {"token": secret})
        return str(answer["user"]), str(answer["role"])

    def log_out(self) -> None:
        """Ends the session."""
        self._request("/session", method="DELETE")

    def approvals(self) -> list[dict[str, Any]]:
        """Returns the requests that wait, as `GET /api/approvals`."""
        return list(self._request("/approvals")["approvals"])

    def answer(self, approval: str, digest: str, is_approved: bool, reason: str) -> None:
        """Approves or rejects a request.

        :param digest: of what the person has read.
        """
        answer = "approve" if is_approved else "reject"
        self._request(f"/approvals/{approval}/{answer}", {"digest": digest, "reason": reason})

    def _request(self, path: str, body: Any = None, method: str = "") -> Any:
        """
        :raises LoggedOut: there is no session.
        :raises Refused: the gateway refuses the request, or cannot be reached.
        :raises TimedOut: it does not answer.
        """
        data = json.dumps(body).encode() if body is not None else None
        headers = {"Content-Type": "application/json", "X-Gateway": "1"}
        try:
            request = urllib.request.Request(f"{self._address}/api{path}", data, headers, method=method or None)
            with self._opener.open(request, timeout=TIMEOUT) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            raise (LoggedOut if error.code == 401 else Refused)(_detail(error)) from error
        except TimeoutError as error:
            raise TimedOut(f"the gateway {self._address} does not answer") from error
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise Refused(f"the gateway {self._address} cannot be reached: {reason}") from error


def _detail(error: urllib.error.HTTPError) -> str:
    try:
        return str(json.load(error)["detail"])
    except (OSError, ValueError, LookupError, TypeError):
        return str(error)
