"""Client certificates of the OPC UA server, and its own certificate and key."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua")

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto import security_policies
from cryptography import x509
from cryptography.hazmat.primitives import serialization

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.opcua.trust_list import TrustList, _Channel, _channel
from support.certificates import make_certificate
from support.opcua import opcua_server
from unit.skiros2_gateway.opcua_client import NO_COMMENT, Mes

Run = Callable[..., None]
UNKNOWN_JOB = 2


async def call(address: str, certificate: Path, key: Path, server: Path, uri: str = "urn:mes") -> int:
    """Calls a method by an encrypted connection; returns its status."""
    mes = Mes(address)
    mes.application_uri = uri
    await mes.set_security_string(f"Basic256Sha256,SignAndEncrypt,{certificate},{key},{server}")
    async with mes:
        await mes.load()
        return int(await mes.call("Start", "unknown", NO_COMMENT))


def test_client_certificate_is_refused_and_kept_until_a_person_has_accepted_it(in_gateway: Run, tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        folder = gateway.path.parent
        server = opcua_server(gateway.service, folder)
        await server.start()
        own, rejected = folder / "opcua_certificate.der", folder / "opcua/rejected"
        known = make_certificate(tmp_path, "mes", "urn:mes")
        expired = make_certificate(tmp_path, "expired", "urn:mes", days=-1)
        try:
            for files, status in ((known, "BadCertificateUntrusted"), (expired, "BadCertificateTimeInvalid")):
                with pytest.raises(ua.UaStatusCodeError) as refused:
                    await call(server.address, *files, own)
                assert refused.value.code == getattr(ua.StatusCodes, status)
            assert sorted(file.name.partition("_")[0] for file in rejected.iterdir()) == ["expired", "mes"]
            for file in list(rejected.iterdir()):
                shutil.move(file, folder / "opcua/trusted/certs")
            assert await call(server.address, *known, own) == UNKNOWN_JOB
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await call(server.address, *known, own, uri="urn:other")
            assert refused.value.code == ua.StatusCodes.BadCertificateUriInvalid
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await call(server.address, *expired, own)
            assert refused.value.code == ua.StatusCodes.BadCertificateTimeInvalid
        finally:
            await server.stop()

    in_gateway(test)


@pytest.mark.long
def test_pem_files_of_any_name_are_read_and_a_wrong_key_is_named(in_gateway: Run, tmp_path: Path) -> None:
    certificate, key = make_certificate(tmp_path, "gateway", "urn:plant:gateway")
    other = make_certificate(tmp_path, "other", "urn:other")[1]
    renamed = tmp_path / "gateway.crt", tmp_path / "gateway.key"
    shutil.copy(certificate, renamed[0])
    shutil.copy(key, renamed[1])
    encrypted = tmp_path / "secret.key"
    private = serialization.load_pem_private_key(key.read_bytes(), None)
    secret = serialization.BestAvailableEncryption(b"secret")
    encrypted.write_bytes(private.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, secret))

    async def test(gateway: Any) -> None:
        folder = gateway.path.parent
        server = opcua_server(gateway.service, folder, certificate=str(renamed[0]), key=str(renamed[1]))
        await server.start()
        try:
            async with Mes(server.address, "view") as mes:
                assert "urn:plant:gateway" in await mes.get_namespace_array()
        finally:
            await server.stop()
        for wrong, text in ((other, "another certificate"), (encrypted, "encrypted"), (tmp_path / "no.key", "No such")):
            server = opcua_server(gateway.service, folder, certificate=str(renamed[0]), key=str(wrong))
            with pytest.raises(ConfigurationError, match=f"{wrong.name}: .*{text}"):
                await server.start()

    in_gateway(test)


def test_client_that_names_another_certificate_than_its_own_is_refused(in_gateway: Run, tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        folder = gateway.path.parent
        server = opcua_server(gateway.service, folder)
        await server.start()
        known, _ = make_certificate(tmp_path, "mes", "urn:mes")
        shutil.copy(known, folder / "opcua/trusted/certs")
        der = x509.load_pem_x509_certificate(known.read_bytes()).public_bytes(serialization.Encoding.DER)
        own = make_certificate(tmp_path, "own", "urn:mes")
        try:
            for named, status in ((der, "BadCertificateInvalid"), (b"", "BadUserAccessDenied")):
                mes = Mes(server.address)
                mes.application_uri = "urn:mes"
                security = f"Basic256Sha256,SignAndEncrypt,{own[0]},{own[1]},{folder / 'opcua_certificate.der'}"
                await mes.set_security_string(security)
                create = mes.uaclient.create_session

                async def forged(parameters: Any, named: bytes = named, create: Any = create) -> Any:
                    parameters.ClientCertificate = named
                    return await create(parameters)

                mes.uaclient.create_session = forged
                with pytest.raises(ua.UaStatusCodeError) as refused:
                    await mes.connect()
                assert refused.value.code == getattr(ua.StatusCodes, status)
        finally:
            await server.stop()

    in_gateway(test)


def test_certificate_is_ignored_without_a_security_policy(in_server: Run, tmp_path: Path) -> None:
    certificate, _ = make_certificate(tmp_path, "plain", "urn:mes")
    der = x509.load_pem_x509_certificate(certificate.read_bytes()).public_bytes(serialization.Encoding.DER)

    async def test(gateway: Any) -> None:
        mes = Mes(gateway.address)
        create = mes.uaclient.create_session

        async def named(parameters: Any) -> Any:
            parameters.ClientCertificate = der
            return await create(parameters)

        mes.uaclient.create_session = named
        async with mes:
            await mes.load()
            assert await mes.call("Start", "unknown", NO_COMMENT) == UNKNOWN_JOB

    in_server(test)


class _Authority:
    """An authority made by openssl, with a database, as its program `ca` needs it."""

    def __init__(self, folder: Path, name: str, issuer: _Authority | None = None) -> None:
        self.folder = folder / name
        self.folder.mkdir()
        self._config = self.folder / "ca.cnf"
        self._config.write_text(_CONFIG.format(folder=self.folder))
        (self.folder / "index.txt").touch()
        self.certificate = self.folder / "ca.pem"
        options = ["-extensions", "authority", "-subj", f"/CN={name}", "-keyout", str(self.folder / "ca_key.pem")]
        if issuer is None:
            self._run("req", "-x509", "-newkey", "rsa:2048", "-nodes", *options, "-out", str(self.certificate))
        else:
            request = self.folder / "request.pem"
            self._run("req", "-newkey", "rsa:2048", "-nodes", *options[2:], "-out", str(request))
            issuer.sign(request, self.certificate, "authority")

    def _run(self, program: str, *arguments: str) -> None:
        command = ["openssl", program, "-config", str(self._config), *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    def sign(self, request: Path, certificate: Path, extensions: str, *options: str) -> None:
        options = ("-batch", "-notext", "-extensions", extensions, *options)
        self._run("ca", *options, "-in", str(request), "-out", str(certificate))

    def client(self, name: str, *options: str) -> tuple[Path, Path]:
        """Returns the files of a client's certificate and key."""
        files = [self.folder / f"{name}{end}.pem" for end in ("", "_key", "_request")]
        self._run(
            "req",
            "-newkey",
            "rsa:2048",
            "-nodes",
            "-subj",
            f"/CN={name}",
            "-keyout",
            str(files[1]),
            "-out",
            str(files[2]),
        )
        self.sign(files[2], files[0], "client", *options)
        return files[0], files[1]

    def revoke(self, certificate: Path) -> None:
        self._run("ca", "-revoke", str(certificate))

    def crl(self, file: Path, *options: str) -> None:
        self._run("ca", "-gencrl", *options, "-out", str(file))


_CONFIG = """
[ca]
default_ca = own
[own]
database = {folder}/index.txt
new_certs_dir = {folder}
certificate = {folder}/ca.pem
private_key = {folder}/ca_key.pem
default_md = sha256
default_days = 10
default_crl_days = 10
policy = any
rand_serial = yes
unique_subject = no
[any]
commonName = supplied
[req]
distinguished_name = name
prompt = no
[name]
[authority]
basicConstraints = critical, CA:TRUE
keyUsage = critical, keyCertSign, cRLSign
subjectKeyIdentifier = hash
[client]
basicConstraints = critical, CA:FALSE
keyUsage = critical, digitalSignature, nonRepudiation, keyEncipherment, dataEncipherment
extendedKeyUsage = clientAuth
authorityKeyIdentifier = keyid
subjectAltName = URI:urn:mes, DNS:localhost
"""


def test_authority_decides_which_clients_are_accepted(tmp_path: Path) -> None:
    trust, pki = TrustList(tmp_path / "opcua"), tmp_path / "opcua"
    root = _Authority(tmp_path, "root")
    line = _Authority(tmp_path, "line", root)
    good, stolen = line.client("good"), line.client("stolen")
    expired = line.client("expired", "-startdate", "200101000000Z", "-enddate", "200201000000Z")
    future = line.client("future", "-startdate", "20700101000000Z", "-enddate", "20710101000000Z")

    def status(files: tuple[Path, Path]) -> str:
        certificate = x509.load_pem_x509_certificate(files[0].read_bytes())
        _channel.set(_Channel(certificate))
        try:
            asyncio.run(trust(certificate, ua.ApplicationDescription(ApplicationUri="urn:mes")))
        except ServiceError as error:
            return str(ua.status_codes.get_name_and_doc(error.code)[0])
        return "accepted"

    assert status(good) == "BadCertificateUntrusted"
    shutil.copy(root.certificate, pki / "issuers/certs")
    shutil.copy(line.certificate, pki / "issuers/certs/line.pem")
    assert status(good) == "BadCertificateUntrusted"  # issuers are not trusted themselves
    shutil.copy(root.certificate, pki / "trusted/certs")
    assert status(good) == status(stolen) == "accepted"
    assert status(expired) == status(future) == "BadCertificateTimeInvalid"
    assert status(_Authority(tmp_path, "stranger").client("other")) == "BadCertificateUntrusted"
    line.revoke(stolen[0])
    line.crl(pki / "issuers/crl/line.crl")
    assert (status(good), status(stolen)) == ("accepted", "BadCertificateRevoked")
    shutil.copy(stolen[0], pki / "trusted/certs")  # a person has accepted it once
    assert status(stolen) == "BadCertificateRevoked"
    names = {file.name.rpartition("_")[0] for file in trust.rejected.iterdir()}
    assert names == {"good", "stolen", "expired", "future", "other"}
    line.crl(pki / "issuers/crl/line.crl", "-crl_lastupdate", "20200101000000Z", "-crl_nextupdate", "20200201000000Z")
    assert status(good) == "BadCertificateRevocationUnknown"
    (pki / "issuers/crl/line.crl").unlink()
    root.revoke(line.certificate)
    root.crl(pki / "trusted/crl/root.crl")
    assert status(good) == "BadCertificateRevoked"


def test_client_may_send_the_authorities_between_it_and_the_accepted_one(in_gateway: Run, tmp_path: Path) -> None:
    root = _Authority(tmp_path, "root")
    line = _Authority(tmp_path, "line", root)
    certificate, key = line.client("mes")
    stranger = _Authority(tmp_path, "stranger")
    chain = b"".join(
        x509.load_pem_x509_certificate(file.read_bytes()).public_bytes(serialization.Encoding.DER)
        for file in (certificate, line.certificate)
    )

    async def call(server: Any, folder: Path, *sent: Path, named: bytes | None = None) -> int:
        mes = Mes(server.address)
        mes.application_uri = "urn:mes"
        own = folder / "opcua_certificate.der"
        policy = security_policies.SecurityPolicyBasic256Sha256
        await mes.set_security(policy, certificate, key, server_certificate=own, certificate_chain=[*sent])
        create = mes.uaclient.create_session

        async def with_chain(parameters: Any) -> Any:
            parameters.ClientCertificate = named or parameters.ClientCertificate
            return await create(parameters)

        mes.uaclient.create_session = with_chain
        async with mes:
            await mes.load()
            return int(await mes.call("Start", "unknown", NO_COMMENT))

    async def test(gateway: Any) -> None:
        folder = gateway.path.parent
        server = opcua_server(gateway.service, folder)
        await server.start()
        pki = folder / "opcua"
        try:
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await call(server, folder, line.certificate, root.certificate)
            assert refused.value.code == ua.StatusCodes.BadCertificateUntrusted, "what a client sends is not trusted"
            shutil.copy(root.certificate, pki / "trusted/certs")
            for sent in ((), (stranger.certificate,)):
                with pytest.raises(ua.UaStatusCodeError) as refused:
                    await call(server, folder, *sent)
                assert refused.value.code == ua.StatusCodes.BadCertificateUntrusted
            assert await call(server, folder, line.certificate) == UNKNOWN_JOB
            assert await call(server, folder, line.certificate, root.certificate, named=chain) == UNKNOWN_JOB
            root.revoke(line.certificate)
            root.crl(pki / "trusted/crl/root.crl")
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await call(server, folder, line.certificate)
            assert refused.value.code == ua.StatusCodes.BadCertificateRevoked
        finally:
            await server.stop()

    in_gateway(test)


def test_accepted_client_is_no_authority_for_others(tmp_path: Path) -> None:
    """The certificates of many applications say that they are one."""
    trust = TrustList(tmp_path / "opcua")
    client = _Authority(tmp_path, "client")
    other = x509.load_pem_x509_certificate(client.client("other")[0].read_bytes())
    file, _ = make_certificate(tmp_path, "app", "urn:mes", key=client.folder / "ca_key.pem", common_name="client")
    shutil.copy(file, trust.trusted)
    _channel.set(_Channel(other))
    with pytest.raises(ServiceError) as refused:
        asyncio.run(trust(other, ua.ApplicationDescription(ApplicationUri="urn:mes")))
    assert refused.value.code == ua.StatusCodes.BadCertificateUntrusted


def test_newest_rejected_certificates_are_kept_within_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skiros2_gateway.opcua.trust_list._MAX_REJECTED", 2)
    trust = TrustList(tmp_path)
    (trust.trusted / "notes.txt").write_text("no certificate")
    client = ua.ApplicationDescription(ApplicationUri="urn:mes")

    async def refuse(certificate: x509.Certificate) -> None:
        _channel.set(_Channel(certificate))
        with pytest.raises(ServiceError) as refused:
            await trust(certificate, client)
        assert refused.value.code == ua.StatusCodes.BadCertificateUntrusted

    for name in ("a", "../b", "c"):
        file, _ = make_certificate(tmp_path, name.strip("./"), "urn:mes", common_name=name)
        asyncio.run(refuse(x509.load_pem_x509_certificate(file.read_bytes())))
    assert sorted(file.name.rpartition("_")[0] for file in trust.rejected.iterdir()) == ["_b", "c"]
