"""Every message, service and action has the md5 sum that bags and nodes elsewhere have."""

import importlib

import pytest

MESSAGES = {
    "Condition": "bb14a9ac922b0de986bc6c6a486485a0",
    "Param": "eb04b7504512676dca105ab8842899a4",
    "Property": "5b6c0ddf599766e37ee213fe87f04771",
    "Relation": "6596e75cd61663ae5bcc18bf41e43915",
    "ResourceDescription": "f305b743733527b01e745de4106cca51",
    "SkillProgress": "14c02d9b9938298cf43e256d5d334a4c",
    "Statement": "052db037d902fbb67131a3c41b93b371",
    "TreeProgress": "82e5478691b0800a9d96112287389bb2",
    "WmElement": "0fefbd22eac0424cfa1c8871ee3990af",
    "WmMonitor": "ecc40ec88cb57baaf7cf8c07fd40a3c7",
    "AssignTaskAction": "42510836f496e0f3418e54111ad6de48",
}
SERVICES = {
    "ResourceGetDescriptions": "689dba5a19baf7321e2b246602dfca10",
    "SkillCommand": "1150e5b3a081e2e52deee5d82d9efb98",
    "WmGet": "a03c7fe28a0cdf8073d54434e678721d",
    "WmModify": "3777804bb09a7d142574f0ae4bc21501",
    "WmQueryRelations": "5c95783a21284fc96a095a71049fa510",
    "WmSetRelation": "77bf924d023af391d9b60bf1607be75e",
    "WoLoadAndSave": "c662905d73fbee6703c2eda4c56b6502",
    "WoModify": "dd76bb6e56a5980cc554cb4a6047bd97",
    "WoQuery": "c279e11806ad32f0e36af84c5a02aba8",
}
FIELDS = {  # names and order; the md5 sums cover them, but a failing list says more than a failing sum
    "Condition": ["type", "label", "subject", "predicate", "object", "state"],
    "Param": ["param"],
    "Property": ["key", "dataValue", "dataType"],
    "Relation": ["subjectId", "predicate", "objectId"],
    "ResourceDescription": ["type", "name", "params"],
    "SkillProgress": [
        "robot", "task_id", "id", "parent_label", "parent_id", "type", "label", "params", "processor", "state",
        "progress_code", "progress_period", "progress_time", "progress_message",
    ],
    "Statement": ["relation", "value"],
    "TreeProgress": ["progress"],
    "WmElement": ["id", "type", "label", "properties", "relations"],
    "WmMonitor": ["prev_snapshot_id", "snapshot_id", "stamp", "author", "action", "elements", "relation"],
    "AssignTaskGoal": ["author", "goals"],
    "AssignTaskResult": ["progress_code", "progress_message"],
    "AssignTaskFeedback": ["progress_code", "progress_message"],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "md5"), [(f"msg.{name}", md5) for name, md5 in MESSAGES.items()])
def test_message_has_the_md5_sum_of_existing_systems(kind: str, md5: str) -> None:
    assert definition(kind)._md5sum == md5


@pytest.mark.parametrize(("kind", "md5"), [(f"srv.{name}", md5) for name, md5 in SERVICES.items()])
def test_service_has_the_md5_sum_of_existing_systems(kind: str, md5: str) -> None:
    assert definition(kind)._md5sum == md5


@pytest.mark.parametrize(("name", "fields"), FIELDS.items())
def test_message_fields_keep_names_and_order(name: str, fields: list[str]) -> None:
    assert definition(f"msg.{name}").__slots__ == fields


def definition(kind: str):
    module, name = kind.split(".")
    return getattr(importlib.import_module(f"skiros2_msgs.{module}"), name)
