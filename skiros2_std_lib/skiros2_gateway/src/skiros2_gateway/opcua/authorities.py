"""Chains of client certificates and their revocation, by the files of a folder as OPC UA stores them (Part 12, PKI)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

from asyncua import ua
from asyncua.common.utils import ServiceError
from cryptography import x509
from cryptography.x509.verification import PolicyBuilder, Store, VerificationError

from skiros2_gateway.opcua.identity import application_uris, read_certificate, read_crl

log = logging.getLogger(__name__)

T = TypeVar("T")


class Authorities:
    """Reads the files for each check: what a person has put there counts at once.

    :param folder: gets the folders `certs` and `crl` below `trusted` and `issuers`. A certificate is trusted if it is
        in `trusted/certs`, or if a chain over `issuers/certs` leads to an authority there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.trusted = folder / "trusted/certs"
        for kind in ("trusted", "issuers"):
            for name in ("certs", "crl"):
                (folder / kind / name).mkdir(parents=True, exist_ok=True)

    def check(self, certificate: x509.Certificate, sent: Sequence[x509.Certificate] = ()) -> None:
        """
        :param sent: the authorities that the client has sent with its certificate. They are used as those of `issuers`.
        :raises ServiceError: the certificate is not trusted, or is revoked, as one of its authorities may be.
        """
        trusted = self._read(("trusted",), "certs", read_certificate)
        # The certificate of an application is not that of an authority, whatever it says: many self-signed ones do.
        found = (*self._read(("issuers",), "certs", read_certificate), *sent)
        others = [each for each in found if not application_uris(each)]
        authorities = [each for each in trusted if not application_uris(each)]
        chain = [certificate] if certificate in trusted else _chain(certificate, authorities, others)
        crls = self._read(("trusted", "issuers"), "crl", read_crl)
        for each in chain:
            _check_revoked(each, crls, [*authorities, *others])

    def _read(self, kinds: Iterable[str], name: str, read: Callable[[Path], T]) -> list[T]:
        found = []
        for file in (file for kind in kinds for file in sorted((self._folder / kind / name).iterdir())):
            try:
                found.append(read(file))
            except (OSError, ValueError) as error:
                log.warning("OPC UA: %s cannot be read: %s", file, error)
        return found


def _chain(
    certificate: x509.Certificate, trusted: Sequence[x509.Certificate], others: Sequence[x509.Certificate]
) -> Sequence[x509.Certificate]:
    """Returns the chain from a certificate to a trusted authority.

    :raises ServiceError: there is none.
    """
    try:
        if trusted:
            return PolicyBuilder().store(Store(trusted)).build_client_verifier().verify(certificate, [*others]).chain
    except VerificationError as error:
        log.info("OPC UA: no chain to a trusted authority: %s", error)
    raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


def _check_revoked(
    certificate: x509.Certificate, crls: Iterable[x509.CertificateRevocationList], issuers: Sequence[x509.Certificate]
) -> None:
    """Checks the lists of a certificate's issuer: there may be none. A list that has expired says nothing.

    :raises ServiceError: it is revoked, or that is not known.
    """
    keys = [each.public_key() for each in issuers if each.subject == certificate.issuer]
    lists = [
        crl for crl in crls if crl.issuer == certificate.issuer and any(crl.is_signature_valid(key) for key in keys)
    ]
    if any(crl.get_revoked_certificate_by_serial_number(certificate.serial_number) for crl in lists):
        raise ServiceError(ua.StatusCodes.BadCertificateRevoked)
    now = datetime.now(UTC)
    if lists and not any(crl.next_update_utc is None or now <= crl.next_update_utc for crl in lists):
        raise ServiceError(ua.StatusCodes.BadCertificateRevocationUnknown)
