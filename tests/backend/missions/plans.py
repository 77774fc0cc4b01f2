"""A plan as QGroundControl writes it, with what is not understood here."""

from __future__ import annotations

import copy
from typing import Any


def simple(command: int, jump_id: int, params: list[Any], frame: int = 3) -> dict[str, Any]:
    return {
        "AMSLAltAboveTerrain": None, "Altitude": params[6], "AltitudeMode": 1, "autoContinue": True,
        "command": command, "doJumpId": jump_id, "frame": frame, "params": params, "type": "SimpleItem",
    }  # fmt: skip


_PLAN: dict[str, Any] = {
    "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
    "mission": {
        "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5,
        "globalPlanAltitudeMode": 1, "plannedHomePosition": [47.39774, 8.545594, 488.0],
        "items": [
            simple(22, 1, [15, 0, 0, None, 47.397742, 8.545594, 50]),
            {
                "type": "ComplexItem", "complexItemType": "survey", "version": 5, "angle": 45,
                "polygon": [[47.398, 8.546], [47.399, 8.546], [47.399, 8.547]],
                "TransectStyleComplexItem": {
                    "version": 2, "CameraCalc": {"CameraName": "Sony ILCE-QX1", "version": 2},
                    "Items": [
                        simple(16, 2, [0, 0, 0, None, 47.3981, 8.5461, 50]),
                        simple(16, 3, [0, 0, 0, None, 47.3989, 8.5469, 50]),
                    ],
                },
            },
            simple(177, 7, [3, 2, 0, 0, 0, 0, 0], frame=2),
            simple(20, 8, [0, 0, 0, 0, 0, 0, 0], frame=2),
        ],
    },
    "geoFence": {
        "version": 2, "breachReturn": [47.3978, 8.5457, 540.0],
        "polygons": [
            {"inclusion": True, "version": 1,
             "polygon": [[47.39, 8.54], [47.39, 8.55], [47.41, 8.55], [47.41, 8.54]]}
        ],
        "circles": [{"inclusion": False, "version": 1, "circle": {"center": [47.405, 8.545], "radius": 60.5}}],
    },
    "rallyPoints": {"version": 2, "points": [[47.396, 8.544, 30.0]]},
    "x-of-somebody-else": {"kept": ["\ud800", 1e300, 12345678901234567890]},
}  # fmt: skip


def plan_document() -> dict[str, Any]:
    return copy.deepcopy(_PLAN)


# Of Mission Planner: item 0 is home, jumps count with it.
WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.39774\t8.545594\t488.0\t1
1\t0\t3\t22\t15\t0\t0\t0\t47.397742\t8.546921\t60\t1
2\t0\t3\t16\t0\t0\t0\tnan\t47.4022336\t8.5522294\t80\t1
3\t0\t2\t177\t2\t1\t0\t0\t0\t0\t0\t1
"""
