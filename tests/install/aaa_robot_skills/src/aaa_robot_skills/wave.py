from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_msgs.msg import WmElement


class Wave(SkillDescription):
    def createDescription(self):
        self.addParam("Times", 1, ParamTypes.Required)


class wave(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Wave(), self.__class__.__name__)

    def execute(self):
        return self.success(f"waved {self.params['Times'].value} times as {WmElement.__name__}")
