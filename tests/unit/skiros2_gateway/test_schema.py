"""Requests generated from the OpenAPI document: no failure, no undocumented status, each answer as documented."""

from __future__ import annotations

from pathlib import Path

from support.schema_requests import send_generated, send_valid, served_gateway


def test_answers_to_generated_requests_are_as_documented(tmp_path: Path) -> None:
    with served_gateway(tmp_path) as address:
        found = send_generated(address, 4)
        assert {200, 401, 403, 404, 422} <= found.keys(), found


def test_answers_to_valid_requests_match_their_schemas(tmp_path: Path) -> None:
    with served_gateway(tmp_path) as address:
        send_valid(address)
