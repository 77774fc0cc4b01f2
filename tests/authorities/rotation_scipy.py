"""Write rotation_scipy.json: rotations as SciPy has them."""

import json
from pathlib import Path

import numpy as np
import scipy
from scipy.spatial.transform import Rotation, Slerp

EULER_DEG = [  # roll, pitch, yaw
    (0.0, 0.0, 0.0),
    (10.0, 0.0, 0.0),
    (0.0, 10.0, 0.0),
    (0.0, 0.0, 10.0),
    (30.0, -20.0, 100.0),
    (-170.0, 85.0, -179.0),
    (5.0, -89.0, 45.0),
    (179.9, 0.1, 179.9),
    (-60.0, 45.0, -120.0),
    (90.0, 0.0, 90.0),
    (0.001, -0.002, 0.003),
]


def wxyz(rotation: Rotation) -> list[float]:
    """The quaternion with the scalar first, w not negative."""
    return rotation.as_quat(canonical=True, scalar_first=True).tolist()


def main() -> None:
    """Compute and write."""
    rng = np.random.default_rng(4711)
    # Intrinsic yaw, pitch, roll: the aviation sequence, matrix ned_from_body.
    rotations = [Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True) for roll, pitch, yaw in EULER_DEG]
    randoms = [Rotation.random(rng=rng) for _ in range(12)]
    # Half turns, where every formula for the quaternion of a matrix has a case to choose.
    halves = [Rotation.from_rotvec(np.pi * np.array(axis)) for axis in np.eye(3)]
    answers = {
        "source": f"SciPy {scipy.__version__}",
        "rotations": [
            {
                "roll_deg": None if euler is None else euler[0],
                "pitch_deg": None if euler is None else euler[1],
                "yaw_deg": None if euler is None else euler[2],
                "q_wxyz": wxyz(rotation),
                "matrix": rotation.as_matrix().tolist(),
                "rotvec": rotation.as_rotvec().tolist(),
            }
            for euler, rotation in zip(
                EULER_DEG + [None] * (len(randoms) + len(halves)), rotations + randoms + halves, strict=True
            )
        ],
        "products": [
            {"a_wxyz": wxyz(a), "b_wxyz": wxyz(b), "ab_wxyz": wxyz(a * b)}
            for a, b in zip(randoms[:6], randoms[6:], strict=True)
        ],
        "slerp": [
            {
                "a_wxyz": wxyz(a),
                "b_wxyz": wxyz(b),
                "t": t,
                "q_wxyz": wxyz(Slerp((0.0, 1.0), Rotation.concatenate((a, b)))(t)),
            }
            for a, b in zip(randoms[:6], randoms[6:], strict=True)
            for t in (0.0, 0.2, 0.5, 0.9, 1.0)
        ],
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
