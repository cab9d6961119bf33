"""The routes of cameras."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http.cameras import cameras_router
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import EntriesChanged
from support.http_gateway import curl, served
from support.pictures import SEEN, StandInCameras
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="needs Debian's curl")


def camera(topic: str) -> dict[str, Any]:
    return {"id": "x", "type": "skiros:DepthCamera", "label": "", "properties": {"skiros:RgbTopic": [topic]}}


@asynccontextmanager
async def cameras(gateway: Any) -> AsyncIterator[tuple[str, StandInCameras]]:
    view, found = LiveView(CellDocument()), StandInCameras()
    elements = {"skiros:Camera-1": camera(SEEN), "skiros:Camera-2": camera("/dark"), "skiros:Tray-3": {"id": "t"}}
    view.cell.apply(EntriesChanged("elements", elements))
    async with served(gateway.service, routers=[cameras_router(view, found)]) as address:
        yield address, found


def path(eid: str) -> str:
    return f"/api/live/cameras/{eid}/picture"


async def head(address: str, *options: str) -> tuple[int, dict[str, str]]:
    """Returns the status and the fields of an answer's head."""
    token = f"Authorization: Bearer {TOKENS['view']}"
    _, text = await curl(address, path("skiros:Camera-1"), "-D", "-", "-o", "/dev/null", "-H", token, *options)
    lines = str(text).replace("\r", "").split("\n")
    return int(lines[0].split()[1]), {k.lower(): v for k, _, v in (line.partition(": ") for line in lines[1:])}


def test_picture_is_a_jpeg_and_sent_once(in_gateway: Run, tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        async with cameras(gateway) as (address, found):
            out = tmp_path / "picture"
            assert (await curl(address, path("skiros:Camera-1"), "-o", str(out), token=TOKENS["view"]))[0] == 200
            jpeg = (await found.picture(SEEN)).jpeg
            assert hashlib.sha256(out.read_bytes()).digest() == hashlib.sha256(jpeg).digest()
            status, fields = await head(address)
            assert (status, fields["content-type"], fields["cache-control"]) == (200, "image/jpeg", "no-store")
            assert float(fields["x-age"]) == 0.1
            found.age = 7.0
            status, fields = await head(address, "-H", f"If-None-Match: {fields['etag']}")
            assert (status, float(fields["x-age"])) == (304, 7.0)
            assert (await head(address, "-H", 'If-None-Match: "another"'))[0] == 200

    in_gateway(test)


@pytest.mark.parametrize(("eid", "user", "status"), [
    ("skiros:Camera-1", "", 401), ("skiros:Camera-1", "agent", 403), ("skiros:Camera-1", "view", 200),
    ("skiros:Camera-2", "view", 409), ("skiros:Tray-3", "view", 404), ("skiros:Camera-9", "view", 404),
    ("..%2f..%2fetc%2fpasswd", "view", 404), ("%00", "view", 404), ("%ff", "view", 404),
])  # fmt: skip
def test_pictures_are_for_users_and_of_cameras_only(in_gateway: Run, eid: str, user: str, status: int) -> None:
    async def test(gateway: Any) -> None:
        async with cameras(gateway) as (address, found):
            options = ("-o", "/dev/null") if status == 200 else ()
            answer, data = await curl(address, path(eid), *options, token=TOKENS.get(user, ""))
            assert answer == status
            if status >= 400:
                assert data["status"] == status
            assert found.read == {200: [SEEN], 409: ["/dark"]}.get(status, [])

    in_gateway(test)


def test_pictures_count_as_requests_of_the_user(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with cameras(gateway) as (address, _):
            answers = [(await curl(address, path("skiros:Camera-2"), token=TOKENS["view"]))[0] for _ in range(5)]
            assert answers[0] == 409
            assert answers[-1] == 429

    in_gateway(test, rate=2.0)
