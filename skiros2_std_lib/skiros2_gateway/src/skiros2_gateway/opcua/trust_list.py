"""The client certificates that a person has accepted, and those that wait for one."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.uacrypto import x509_from_der
from asyncua.crypto.validator import CertificateValidator
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.x509.oid import NameOID

from skiros2_gateway.opcua.authorities import Authorities

log = logging.getLogger(__name__)

#: How many rejected certificates are kept: the newest.
_MAX_REJECTED = 100
#: How many certificates of a client's chain are read.
_MAX_CHAIN = 10
_SEQUENCE = b"\x30"  # the first byte of a certificate in DER


@dataclass
class _Channel:
    """A secure channel.

    :param certificate: by which the client has signed; None without a security policy.
    :param authorities: those that the client has sent with it: a chain is the bytes of certificates one after the
        other, the own one first (OPC 10000-6, Certificate Chains).
    """

    certificate: x509.Certificate | None
    authorities: Sequence[x509.Certificate] = ()
    is_accepted: bool = False


#: The channel of the request that is processed: all requests of a connection are processed in one task.
_channel: ContextVar[_Channel | None] = ContextVar("channel", default=None)


class TrustingServer(Server):  # type: ignore[misc]
    """asyncua's server, which notes the certificate of each channel: the one that a request names may be another. Of a
    chain in a request, it takes the first certificate, where asyncua's server fails.
    """

    async def _setup_server_nodes(self) -> None:
        await super()._setup_server_nodes()
        for policy in self._policies:
            policy.create = _noting(policy.create, policy.mode is not ua.MessageSecurityMode.None_)
        self.iserver.create_session = _taking_chains(self.iserver.create_session)


def _noting(create: Callable[[bytes | None], Any], is_secure: bool) -> Callable[[bytes | None], Any]:
    def noted(certificate: bytes | None) -> Any:
        policy = create(certificate)
        own, *authorities = [x509_from_der(each) for each in _chain(certificate) if is_secure] or [None]
        _channel.set(_Channel(own, authorities))
        return policy

    return noted


def _chain(data: bytes | None) -> list[bytes]:
    """Returns the certificates of a chain in DER, at most `_MAX_CHAIN`. Bytes that are none end it."""
    found, rest = [], data or b""
    while rest[:1] == _SEQUENCE and len(rest) > 2 and len(found) < _MAX_CHAIN:
        size, start = rest[1], 2
        if size & 0x80:  # the number of bytes that have the size
            start += size & 0x7F
            size = int.from_bytes(rest[2:start], "big")
        found.append(rest[: start + size])
        rest = rest[start + size :]
    return found


def _taking_chains(make: Callable[..., Any]) -> Callable[..., Any]:
    def made(*arguments: Any, **options: Any) -> Any:
        session = make(*arguments, **options)
        create = session.create_session

        async def create_session(parameters: Any, *others: Any, **more: Any) -> Any:
            parameters.ClientCertificate = next(
                iter(_chain(parameters.ClientCertificate)), parameters.ClientCertificate
            )
            return await create(parameters, *others, **more)

        session.create_session = create_session
        return session

    return made


def is_channel_accepted() -> bool:
    """Returns whether a user may log in by the channel of the request: it has no policy, or an accepted certificate."""
    channel = _channel.get()
    return channel is not None and (channel.certificate is None or channel.is_accepted)


class TrustList:
    """asyncua's validator of client certificates.

    :param folder: gets the folder `rejected`, and those of `Authorities`. A person accepts a certificate by moving its
        file to `trusted/certs`.
    """

    def __init__(self, folder: Path) -> None:
        self._authorities = Authorities(folder)
        self.trusted, self.rejected = self._authorities.trusted, folder / "rejected"
        self.rejected.mkdir(exist_ok=True)
        self._validator = CertificateValidator()  # dates, and the application's URI

    async def __call__(self, certificate: x509.Certificate, client: ua.ApplicationDescription) -> None:
        """Checks the certificate of a client that opens a session; none is needed without a security policy.

        :raises ServiceError: the client is refused.
        """
        channel = _channel.get()
        if channel is None or channel.certificate is None:
            return
        try:
            if certificate != channel.certificate:
                certificate = channel.certificate
                raise ServiceError(ua.StatusCodes.BadCertificateInvalid)
            await self._validator.validate(certificate, client)
            self._authorities.check(certificate, channel.authorities)
            channel.is_accepted = True
        except ServiceError as error:
            status = ua.status_codes.get_name_and_doc(error.code)[0]
            log.warning(
                "OPC UA: client %s refused: %s. Its certificate is %s; a valid one is accepted once it is in %s",
                client.ApplicationUri, status, self._keep(certificate), self.trusted,
            )  # fmt: skip
            raise

    def _keep(self, certificate: x509.Certificate) -> Path:
        """Keeps a rejected certificate; the oldest ones give way. Returns its file."""
        names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        name = re.sub(r"[^A-Za-z0-9._-]", "_", str(names[0].value) if names else "")[:60].lstrip(".")
        file = self.rejected / f"{name or 'client'}_{certificate.fingerprint(hashes.SHA256()).hex()[:16]}.der"
        file.write_bytes(certificate.public_bytes(serialization.Encoding.DER))
        files = sorted(self.rejected.iterdir(), key=lambda each: each.stat().st_mtime_ns)
        for oldest in files[:-_MAX_REJECTED]:
            oldest.unlink()
        return file
