from pick_place_skills.descriptions import Detect, Drive, Scan, Sort, Watch, Weigh
from skiros2_common.core.primitive import PrimitiveBase


class drive_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Drive(), self.__class__.__name__)

    def execute(self):
        robot = self.params["Robot"].value
        robot.setRelation("-1", "skiros:at", self.params["TargetLocation"].value.id)
        self.params["Robot"].value = robot
        return self.success("Arrived")


class scan_fake(PrimitiveBase):
    """Finds one thing per tick, in a list that it does not assign again."""

    def createDescription(self):
        self.setDescription(Scan(), self.__class__.__name__)

    def onStart(self):
        self._to_find = ["bolt", "nut", "washer"]
        return True

    def execute(self):
        self.params["Labels"].values.append(self._to_find.pop(0))
        return self.step("Found one") if self._to_find else self.success("Found all")


class sort_fake(PrimitiveBase):
    """Takes what was found, one per tick."""

    def createDescription(self):
        self.setDescription(Sort(), self.__class__.__name__)

    def onStart(self):
        self._bins = {}
        return True

    def execute(self):
        if not self.params["Labels"].values:
            return self.success("All sorted") if len(self._bins) == 3 else self.step("Waiting")
        label = self.params["Labels"].values.pop(0)
        self._bins[label] = len(self._bins)
        self.params["Sorted"].value = self._bins
        return self.step(f"Sorted {label}")


class detect_fake(PrimitiveBase):
    """Adds what it sees, as the very object that its parameter holds."""

    def createDescription(self):
        self.setDescription(Detect(), self.__class__.__name__)

    def execute(self):
        seen = self.params["Detected"].value
        seen.label = "detected"
        seen.addRelation(self.params["Container"].value.id, "skiros:contain", "-1")
        self.wmi.add_element(seen)
        return self.success(f"Detected {seen.id}")


class weigh_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Weigh(), self.__class__.__name__)

    def execute(self):
        product = self.params["Object"].value
        product.setProperty("skiros:Weight", 0.5)
        self.wmi.update_element(product)
        return self.success(f"Weighed {product.id}")


class watch_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Watch(), self.__class__.__name__)

    def execute(self):
        return self.step("Watching {}".format(self.params["Object"].value.label))
