"""The routes of cameras.

- `GET /api/live/cameras/ID/picture`: the newest picture of a camera's element as JPEG. `ETag` is its id, `X-Age` how
  old it is (s). With that id in `If-None-Match`, 304 says that there is no newer one. 409 says why there is none.

A camera is subscribed to while somebody reads its pictures, and five seconds longer.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Response

from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.pictures import Cameras, camera_topic
from skiros2_gateway.http.callers import CallerArg, ServiceArg
from skiros2_gateway.http.errors import errors_of

_ANSWERS: dict[int | str, Any] = {
    **errors_of(404, 409),
    200: {"content": {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}}},
    304: {"description": "no newer picture"},
}


def cameras_router(view: LiveView, cameras: Cameras) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/api/live/cameras")

    @router.get("/{camera}/picture", response_class=Response, responses=_ANSWERS)
    async def camera_picture(
        caller: CallerArg, service: ServiceArg, camera: str, if_none_match: Annotated[str, Header()] = ""
    ) -> Response:
        """The newest picture of a camera."""
        service.view(caller)
        picture = await cameras.picture(camera_topic(view.entry("elements", camera)))
        tag = f'"{picture.id}"'
        headers = {"ETag": tag, "X-Age": f"{picture.age:.3f}", "Cache-Control": "no-store"}
        if if_none_match == tag:
            return Response(status_code=304, headers=headers)
        return Response(picture.jpeg, media_type="image/jpeg", headers=headers)

    return router
