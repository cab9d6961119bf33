"""The settings of the gateway."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

#: The folder of the store and of the file of users, in the user's home.
FOLDER = Path("~/.skiros2/gateway")


class Settings(BaseModel):
    """The settings, as private parameters of the node.

    :param host: address to bind to. Others than that of this machine need `certificate` and `key`.
    :param hosts: further names of this machine by which agents reach `/mcp`, separated by commas.
    :param http_port, opcua_port: 0: a free port; -1: off.
    :param mqtt: HOST or HOST:PORT of a broker; "": off.
    :param bags: folder of recorded runs to look at in the page; "": none.
    :param agents: the Model Context Protocol at `/mcp`: off; a person approves what agents start (ask), or this setting
        does (approved).
    :param approval_timeout: how long an agent's request waits for a person (s).
    :param jobs_at_once: 0: as many as there are robots.
    :param rate, burst: requests per second and user.
    :param max_body: the largest request (bytes).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: Path = FOLDER
    users: str = ""
    work_masters: str = ""
    host: str = "127.0.0.1"
    hosts: str = ""
    http_port: int = Field(8765, ge=-1, le=65535)
    opcua_port: int = Field(-1, ge=-1, le=65535)
    mqtt: str = ""
    mqtt_user: str = ""
    mqtt_password_file: str = ""
    mqtt_ca: str = ""
    mqtt_prefix: str = "skiros2"
    certificate: str = ""
    key: str = ""
    bags: str = ""
    agents: Literal["off", "ask", "approved"] = "off"
    approval_timeout: float = Field(300.0, gt=0.0)
    jobs_at_once: int = Field(0, ge=0, le=1000)
    rate: float = Field(100.0, gt=0.0)
    burst: float = Field(300.0, ge=1.0)
    max_body: int = Field(256 * 1024, ge=1024)

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if bool(self.certificate) != bool(self.key):
            raise ValueError("certificate and key belong together")
        if not self.is_local and not self.certificate:
            raise ValueError(f"host {self.host} is reachable from the network; this needs a certificate and a key")
        return self

    @property
    def is_local(self) -> bool:
        """Whether only programs on this machine can connect."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def users_file(self) -> Path:
        return Path(self.users or self.folder / "users.yaml").expanduser()
