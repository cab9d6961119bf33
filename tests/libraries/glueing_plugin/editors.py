"""A parameter editor."""

import json

from python_qt_binding.QtWidgets import QSlider

from skiros2_gui.skills.widgets.editors import FieldEditor, register_editor


@register_editor
class BeadEditor(FieldEditor):
    """A slider for the width of a bead of glue."""

    @classmethod
    def accepts(cls, field):
        return field.declared.wire_type == "glue::Bead"

    def __init__(self, field, skills):
        super().__init__(field, skills, QSlider())
        self.input.setRange(0, 10)
        self.input.setValue(json.loads(field.text)["width"] if field.text else 0)
        self.input.valueChanged.connect(lambda width: skills.write(field.key, json.dumps({"width": width})))
