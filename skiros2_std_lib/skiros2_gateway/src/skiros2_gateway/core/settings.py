"""The settings of the gateway."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from skiros2_common.core.errors import ConfigurationError

#: The folder of the store and of the file of users, in the user's home.
FOLDER = Path("~/.skiros2/gateway")


class Settings(BaseModel):
    """The settings, as private parameters of the node.

    :param cell: name of the cell, unique in the plant, in the URIs of its OPC UA server; "": a random one, which is
        kept in the folder.
    :param host: address to bind to. Others than that of this machine need `certificate` and `key`.
    :param hosts: further names of this machine by which agents reach `/mcp`, separated by commas.
    :param http_port, opcua_port: 0: a free port; -1: off.
    :param stop_port: of stops only; 0: the one after `http_port`, or a free one if that is 0; -1: off.
    :param mqtt: HOST or HOST:PORT of a broker; "": off. One on another machine needs `mqtt_ca`: TLS.
    :param mqtt_tokens: whether commands may have a token instead of a signature; all who may read the topics read it.
    :param bags: folder of recorded runs to look at in the page; "": none.
    :param cells: YAML file with the gateways of other cells, which the page lists; "": none.
    :param agents: the Model Context Protocol at `/mcp`: off; a person approves what agents start (ask), or this setting
        does (approved).
    :param approval_timeout: how long an agent's request waits for a person (s).
    :param jobs_at_once: 0: as many as there are robots.
    :param keep_days: how long ended jobs and the audit log are kept; 0: for ever.
    :param rate, burst: requests per second and user.
    :param max_body: the largest request (bytes).
    :param connections: HTTP connections of one address.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: Path = FOLDER
    users: str = ""
    work_masters: str = ""
    cell: str = Field("", pattern=r"^([A-Za-z0-9][A-Za-z0-9._-]{0,63})?$")
    host: str = "127.0.0.1"
    hosts: str = ""
    http_port: int = Field(8765, ge=-1, le=65535)
    stop_port: int = Field(0, ge=-1, le=65535)
    opcua_port: int = Field(-1, ge=-1, le=65535)
    mqtt: str = ""
    mqtt_user: str = ""
    mqtt_password_file: str = ""
    mqtt_ca: str = ""
    mqtt_prefix: str = Field("skiros2", pattern=r"^[^#+\x00]*$")
    mqtt_tokens: bool = False
    certificate: str = ""
    key: str = ""
    bags: str = ""
    cells: str = ""
    agents: Literal["off", "ask", "approved"] = "off"
    approval_timeout: float = Field(300.0, gt=0.0)
    jobs_at_once: int = Field(0, ge=0, le=1000)
    keep_days: float = Field(365.0, ge=0.0)
    rate: float = Field(100.0, gt=0.0)
    burst: float = Field(300.0, ge=1.0)
    max_body: int = Field(256 * 1024, ge=1024)
    connections: int = Field(200, ge=1, le=800)

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if bool(self.certificate) != bool(self.key):
            raise ValueError("certificate and key belong together")
        if not self.is_local and not self.certificate:
            raise ValueError(f"host {self.host} is reachable from the network; this needs a certificate and a key")
        if self.mqtt and not self.mqtt_ca and not _is_loopback(self.mqtt.partition(":")[0]):
            raise ValueError(f"the broker {self.mqtt} is on another machine; this needs TLS: mqtt_ca, its CA file")
        return self

    @property
    def is_local(self) -> bool:
        """Whether only programs on this machine can connect."""
        return _is_loopback(self.host)

    @property
    def users_file(self) -> Path:
        return Path(self.users or self.folder / "users.yaml").expanduser()

    def make_folder(self) -> Path:
        """Makes the folder, which only its owner may enter: it has jobs, tokens and keys. Returns it.

        :raises ConfigurationError: it cannot be made, or belongs to another user.
        """
        folder = self.folder.expanduser()
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.chmod(0o700)
        except OSError as error:
            raise ConfigurationError(f"folder {folder}: {error}") from error
        return folder


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
