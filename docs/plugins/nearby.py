"""A cluster policy by geometry: the head stays near the target."""

from typing import Annotated

import numpy as np

from wsnsim import Quantity, part
from wsnsim.plugins import Appointed


@part
class Nearby(Appointed):
    """The head stays near the target: the node nearest to where the target will be leads next."""

    distance: Annotated[float, Quantity("m", gt=0.0), "of the prediction, up to which a head stays"] = 20.0

    def must_appoint(self, outlook):
        (point,) = outlook.path(outlook.forecast.mean, 0.0)
        return bool(np.hypot(*(outlook.place - point)) > self.distance)

    def next_head(self, outlook):
        point = outlook.path(outlook.succession.mean, self.horizon)[-1]
        near = outlook.nodes_near(point, outlook.reach)
        if not near.able.any():
            return None
        away = np.where(near.able, np.hypot(*(near.positions - point).T), np.inf)
        return int(near.ids[away.argmin()])
