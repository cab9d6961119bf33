"""A SPARQL 1.1 endpoint over HTTP, as a store of rdflib."""

from __future__ import annotations

import base64
import http.client
import urllib.error
import urllib.parse
import urllib.request
from io import BytesIO

from rdflib.plugins.stores.sparqlstore import SPARQLUpdateStore
from rdflib.query import Result

from skiros2_common.core.errors import Refused, SkirosError, TimedOut, WrongValue

_ANSWERS = "application/sparql-results+json, application/n-triples;q=0.9, text/turtle;q=0.8"
_FORM = "application/x-www-form-urlencoded"
_UPDATE = "application/sparql-update; charset=UTF-8"
#: The maximum size of an answer.
_MOST_BYTES = 1 << 28
#: The maximum length of a quoted error message of the server (bytes).
_MAX_QUOTE = 500


class EndpointConnection(SPARQLUpdateStore):
    """rdflib's store for an endpoint, extended by a timeout and the server's error messages.

    `query` and `update` are thread-safe, as each call is a separate HTTP request.

    :param query_url, update_url: the endpoint; `http://user:password@host/...` logs in.
    :param seconds: the timeout of an answer (s).
    """

    def __init__(self, query_url: str, update_url: str, seconds: float) -> None:
        super().__init__(query_url, update_url)
        self._query_url, self._update_url = query_url, update_url
        self._seconds = seconds

    def send(self, update: str) -> None:
        """Sends an update immediately, in one request.

        :raises WrongValue: the server cannot parse it.
        :raises Refused: the server cannot be reached, or refuses it.
        :raises TimedOut: the server does not answer in time.
        """
        self._post(self._update_url, update, _UPDATE)

    def _query(self, query: str, default_graph: str | None = None, named_graph: str | None = None) -> Result:
        fields = {"query": query} if default_graph is None else {"query": query, "default-graph-uri": default_graph}
        content, kind = self._post(self._query_url, urllib.parse.urlencode(fields), _FORM)
        try:
            return Result.parse(BytesIO(content), content_type=kind)
        except Exception as error:  # rdflib's parsers raise various exceptions
            url = without_password(self._query_url)
            raise Refused(f"SPARQL endpoint {url} did not answer with a query result ({kind}): {error}") from None

    def _update(self, update: str) -> None:
        self.send(update)

    def _post(self, url: str, text: str, kind: str) -> tuple[bytes, str]:
        """Sends a POST request. Returns the answer and its media type."""
        plain, login = _parted(url)
        headers = {"Content-Type": kind, "Accept": _ANSWERS, **login}
        where = f"SPARQL endpoint {without_password(url)}"
        try:
            request = urllib.request.Request(plain, text.encode(), headers)
            with urllib.request.urlopen(request, timeout=self._seconds) as response:
                content = response.read(_MOST_BYTES + 1)
            if len(content) > _MOST_BYTES:
                raise WrongValue(f"{where}: the answer is larger than {_MOST_BYTES} bytes; expected a LIMIT")
            return content, response.headers.get_content_type()
        except urllib.error.HTTPError as error:
            raise _refusal(where, error) from None
        except TimeoutError:
            raise TimedOut(f"{where}: no answer within {self._seconds:g} s") from None
        except WrongValue:
            raise
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = getattr(error, "reason", None) or error
            if isinstance(reason, TimeoutError):
                raise TimedOut(f"{where}: no answer within {self._seconds:g} s") from None
            raise Refused(f"{where} cannot be reached: {reason}") from None


def without_password(url: str) -> str:
    """A URL without user and password."""
    return _parted(url)[0]


def _refusal(where: str, error: urllib.error.HTTPError) -> SkirosError:
    with error:
        message = error.read(_MAX_QUOTE).decode(errors="replace").strip()
        text = f"{where} answered {error.code} {error.reason}: {message}"
    return WrongValue(text) if error.code == http.client.BAD_REQUEST else Refused(text)


def _parted(url: str) -> tuple[str, dict[str, str]]:
    """A URL without user and password, and the HTTP header with them."""
    parts = urllib.parse.urlsplit(url)
    user, at, host = parts.netloc.rpartition("@")
    login = base64.b64encode(urllib.parse.unquote(user).encode()).decode()
    return parts._replace(netloc=host).geturl(), {"Authorization": f"Basic {login}"} if at else {}
