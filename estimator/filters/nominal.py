"""The nominal state of the error-state filter, and where in its error state each group lies."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimator.filters.strapdown import Motion
from estimator.types import Float

STATE_GROUPS = (
    "position", "velocity", "attitude", "accelerometer_bias", "gyroscope_bias", "barometer_bias", "boresight",
    "attitude_bias", "ground_bias", "map_bias", "map_region", "map_offset", "gnss_bias", "clone_position",
    "clone_rotation", "keyframe_position", "keyframe_rotation", "structure", "pad_position", "pad_rotation",
)  # fmt: skip
PAD_GROUPS = ("pad_position", "pad_rotation")
"""Of a landing pad: position of its centre and small rotation, both about the NED axes."""
_SIZES = {"barometer_bias": 1, "ground_bias": 2, "map_bias": 2, "map_region": 2, "map_offset": 2, "gnss_bias": 2}


@dataclass(frozen=True, slots=True)
class Layout:
    """Which error states there are, and where."""

    slices: dict[str, slice]
    size: int

    @classmethod
    def of(cls, groups: tuple[str, ...]) -> Layout:
        """The layout of the named groups, in the order of ``STATE_GROUPS``; raises ValueError on unknown names."""
        unknown = set(groups) - set(STATE_GROUPS)
        if unknown:
            message = f"unknown state groups: {', '.join(sorted(unknown))}"
            raise ValueError(message)
        slices: dict[str, slice] = {}
        start = 0
        for name in STATE_GROUPS:
            if name in groups:
                size = _SIZES.get(name, 3)
                slices[name] = slice(start, start + size)
                start += size
        return cls(slices, start)

    def has(self, name: str) -> bool:
        """Whether a group is estimated."""
        return name in self.slices

    def jacobian(self, rows: int, **blocks: Float) -> Float:
        """A measurement Jacobian (rows, size) with the given blocks; blocks of absent groups are dropped."""
        H = np.zeros((rows, self.size))
        for name, block in blocks.items():
            where = self.slices.get(name)
            if where is not None:
                H[:, where] = block
        return H


@dataclass(frozen=True, slots=True, eq=False)
class Clone:
    """Camera position (3,) NED and attitude at an earlier picture, as now estimated."""

    pos_ned_m: Float
    q_ned_from_camera: Float


@dataclass(frozen=True, slots=True, eq=False)
class PadPlace:
    """Where a landing pad lies, as now estimated: its centre (3,) NED and its attitude."""

    pos_ned_m: Float
    q_ned_from_pad: Float


@dataclass(frozen=True, slots=True, eq=False)
class Nominal:
    """The estimate itself: motion, biases, and the landing pad once it has been seen."""

    motion: Motion
    accelerometer_bias_m_s2: Float
    gyroscope_bias_rad_s: Float
    barometer_bias_m: float
    boresight_rad: Float
    attitude_bias_rad: Float
    ground_biases_m: Float = field(default_factory=lambda: np.zeros(2))
    map_bias_ne_m: Float = field(default_factory=lambda: np.zeros(2))
    map_region_ne_m: Float = field(default_factory=lambda: np.zeros(2))
    map_offset_ne_m: Float = field(default_factory=lambda: np.zeros(2))
    gnss_bias_ne_m: Float = field(default_factory=lambda: np.zeros(2))
    clone: Clone | None = None
    keyframe: Clone | None = None
    structure_m: Float = field(default_factory=lambda: np.zeros(3))
    pad: PadPlace | None = None

    def moved(self, motion: Motion, kept: Float, index: dict[str, slice]) -> Nominal:
        """After a step that left so much (size,) of each state.

        Spelled out, because ``replace`` on so many fields is a tenth of what a prediction costs.
        """
        bias, ground = index.get("attitude_bias"), index.get("ground_bias")
        imagery, region, satellites = index.get("map_bias"), index.get("map_region"), index.get("gnss_bias")
        return Nominal(
            motion, self.accelerometer_bias_m_s2, self.gyroscope_bias_rad_s, self.barometer_bias_m, self.boresight_rad,
            self.attitude_bias_rad if bias is None else self.attitude_bias_rad * kept[bias],
            self.ground_biases_m if ground is None else self.ground_biases_m * kept[ground],
            self.map_bias_ne_m if imagery is None else self.map_bias_ne_m * kept[imagery],
            self.map_region_ne_m if region is None else self.map_region_ne_m * kept[region],
            self.map_offset_ne_m,
            self.gnss_bias_ne_m if satellites is None else self.gnss_bias_ne_m * kept[satellites],
            self.clone, self.keyframe, self.structure_m, self.pad,
        )  # fmt: skip

    @property
    def ground_bias_m(self) -> float:
        """How far what is seen lies below the ground model."""
        return float(self.ground_biases_m.sum())

    @property
    def map_displacement_ne_m(self) -> Float:
        """How far (2,) the imagery is displaced here, for all its reasons."""
        total: Float = self.map_bias_ne_m + self.map_region_ne_m + self.map_offset_ne_m
        return total
