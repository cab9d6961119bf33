"""One skill that misbehaves where and as it is told to."""

import sys
import threading

import rospy

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import serializeParamMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs


class Unruly(SkillDescription):
    def createDescription(self):
        self.addParam("Where", "", ParamTypes.Required, description="The hook")
        self.addParam("What", "", ParamTypes.Required)
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Optional)


class unruly(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Unruly(), "unruly")

    def onStart(self):
        self.ticks = 0
        return self._misbehave("onStart", True)

    def execute(self):
        self.ticks += 1
        if self.ticks < 3 and self.params["Where"].value in ("onPreempt", "onEnd"):
            return self.step("at work")
        return self._misbehave("execute", self.success("done"))

    def onPreempt(self):
        return self._misbehave("onPreempt", self.fail("stopped", 1))

    def onEnd(self):
        return self._misbehave("onEnd", True)

    def _misbehave(self, hook, otherwise):
        what = self.params["What"].value
        if self.params["Where"].value != hook:
            return otherwise
        if what == "raise":
            raise RuntimeError("out of coffee")
        if what == "exit":
            sys.exit("I am off")
        if what == "recurse":
            return self._misbehave(hook, otherwise)
        if what == "thread":
            threading.Thread(target=self._in_a_thread).start()
            return otherwise
        if what == "ask":  # services of its own manager
            name = rospy.get_name()
            rospy.ServiceProxy(f"{name}/get_skills", srvs.ResourceGetDescriptions)()
            count = Param("CountTarget", "", 1, ParamTypes.Required)
            skill = msgs.ResourceDescription("skiros:Counter", "counter", serializeParamMap({"CountTarget": count}))
            rospy.ServiceProxy(f"{name}/command", srvs.SkillCommand)("unruly", "start", -1, [skill])
            return otherwise
        if what == "remove":
            self.wmi.remove_element(self.params["Thing"].value)
            return otherwise
        if what == "forget":
            self.params["Thing"].value.setProperty("skiros:Weight", 1.0)
            self.wmi.remove_element(self.wmi.get_element(self.params["Thing"].value.id))
            return otherwise
        if what == "theirs":
            self.params["Words"].value = "mine"
        return {"nothing": None, "true": True, "false": False, "number": 7}[what]

    def _in_a_thread(self):
        for _ in range(100):
            self.params["Thing"].unset()
            self.fail("from a thread", 99)
        raise RuntimeError("a thread without a net")
