"""Write homography_opencv.json: homographies of level ground from four points that OpenCV projected."""

import json
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

FX, FY, CX, CY = 554.3, 551.9, 322.1, 236.8
MATRIX = np.array(((FX, 0.0, CX), (0.0, FY, CY), (0.0, 0.0, 1.0)))
# Rows: the axes of a nadir camera's frame (right, down, forward) in a body that points north.
BODY_FROM_CAMERA = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
GROUND_DOWN_M = 12.0
GROUND_NE_M = np.array(((-40.0, -50.0), (-35.0, 55.0), (60.0, 45.0), (50.0, -60.0)))

POSES = [  # camera north, east, down (metres); roll, pitch, yaw of the body (degrees)
    ((0.0, 0.0, -110.0), (0.0, 0.0, 0.0)),
    ((5.0, -8.0, -105.0), (4.0, -6.0, 30.0)),
    ((-12.0, 20.0, -130.0), (-15.0, 10.0, -140.0)),
    ((3.0, 2.0, -95.0), (2.0, 25.0, 200.0)),
]


def pixels(position: tuple[float, ...], ned_from_camera: np.ndarray) -> np.ndarray:
    """Pixels (4, 2) of the ground's points."""
    ned = np.column_stack((GROUND_NE_M, np.full(4, GROUND_DOWN_M)))
    camera_from_ned = ned_from_camera.T
    turn, _ = cv2.Rodrigues(camera_from_ned)
    shift = -camera_from_ned @ np.array(position)
    return cv2.projectPoints(ned, turn, shift, MATRIX, np.zeros(5))[0][:, 0]


def main() -> None:
    """Compute and write."""
    answers = {
        "source": f"OpenCV {cv2.__version__}: projectPoints, getPerspectiveTransform (float32 corners, so to 1e-6)",
        "fx_px": FX,
        "fy_px": FY,
        "cx_px": CX,
        "cy_px": CY,
        "ground_down_m": GROUND_DOWN_M,
        "ground_ne_m": GROUND_NE_M.tolist(),
        "poses": [],
    }
    for position, (roll, pitch, yaw) in POSES:
        ned_from_camera = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix() @ BODY_FROM_CAMERA
        uv = pixels(position, ned_from_camera)
        answers["poses"].append(
            {
                "camera_pos_ned_m": position,
                "ned_from_camera": ned_from_camera.tolist(),
                "ground_uv_px": uv.tolist(),
                "pixel_from_ground": cv2.getPerspectiveTransform(
                    GROUND_NE_M.astype(np.float32), uv.astype(np.float32)
                ).tolist(),
            }
        )
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
