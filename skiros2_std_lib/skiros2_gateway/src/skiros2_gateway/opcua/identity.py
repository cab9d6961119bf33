"""The name of a cell, and the certificate by which clients know its server."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_der_private_key, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.core.settings import Settings

_PEM = b"-----BEGIN"


@dataclass
class Identity:
    """
    :param uri: of the application; the certificate has the same.
    """

    uri: str
    certificate: x509.Certificate
    key: Any


def cell_name(settings: Settings) -> str:
    """Returns the name of the cell: the setting, or a random one that is made once and kept in the folder.

    :raises ConfigurationError: the file of the name cannot be read or written.
    """
    if settings.cell:
        return settings.cell
    file = settings.folder.expanduser() / "cell_name"
    try:
        if not file.is_file():
            file.write_text(secrets.token_hex(8))
        return file.read_text().strip()
    except OSError as error:
        raise ConfigurationError(f"name of the cell {file}: {error}") from error


async def own_certificate(settings: Settings, cell: str) -> Identity:
    """Returns the certificate and key that the settings name, or self-signed ones, which are made once in the folder.

    :raises ConfigurationError: they cannot be read.
    """
    uri = f"urn:skiros2:gateway:{cell}"
    certificate, key = Path(settings.certificate), Path(settings.key)
    if not settings.certificate:
        folder = settings.folder.expanduser()
        certificate, key = folder / "opcua_certificate.der", folder / "opcua_key.pem"
        usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        await setup_self_signed_certificate(
            key, certificate, uri, socket.gethostname(), usage, {"organizationName": "SkiROS2"}
        )
        key.chmod(0o600)
    try:
        made = read_certificate(certificate)
        content = key.expanduser().read_bytes()
        private = load_pem_private_key(content, None) if _PEM in content else load_der_private_key(content, None)
    except (OSError, ValueError, TypeError) as error:  # TypeError: the key has a password
        raise ConfigurationError(f"certificate {certificate}, key {key}: {error}") from error
    if made.public_key() != private.public_key():
        raise ConfigurationError(f"certificate {certificate}, key {key}: the key is of another certificate")
    return Identity(next(iter(application_uris(made)), uri), made, private)


def read_certificate(file: Path) -> x509.Certificate:
    """Reads a certificate, PEM or DER, whatever the file's name.

    :raises OSError, ValueError: it cannot be read.
    """
    content = file.expanduser().read_bytes()
    return x509.load_pem_x509_certificate(content) if _PEM in content else x509.load_der_x509_certificate(content)


def read_crl(file: Path) -> x509.CertificateRevocationList:
    """Reads a list of revoked certificates, PEM or DER, whatever the file's name.

    :raises OSError, ValueError: it cannot be read.
    """
    content = file.read_bytes()
    return x509.load_pem_x509_crl(content) if _PEM in content else x509.load_der_x509_crl(content)


def application_uris(certificate: x509.Certificate) -> list[str]:
    """Returns the URIs in a certificate; that of an authority has none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return names.get_values_for_type(x509.UniformResourceIdentifier)
