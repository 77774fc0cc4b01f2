"""Write camera_opencv.json: pixels through distorted lenses as OpenCV has them."""

import json
from pathlib import Path

import cv2
import numpy as np

CAMERAS = [  # width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3) in OpenCV's order
    (640, 480, 700.0, 700.0, 319.5, 239.5, (0.0, 0.0, 0.0, 0.0, 0.0)),
    (640, 480, 554.3, 551.9, 322.1, 236.8, (-0.12, 0.05, 0.0008, -0.0004, -0.01)),
    (1920, 1080, 1450.0, 1452.0, 955.0, 544.0, (-0.28, 0.11, -0.0005, 0.0003, -0.02)),
    (1280, 720, 900.0, 900.0, 640.0, 360.0, (0.09, -0.03, 0.002, 0.001, 0.004)),
]


def main() -> None:
    """Compute and write."""
    rng = np.random.default_rng(4712)
    answers = {"source": f"OpenCV {cv2.__version__}: projectPoints, undistortPointsIter", "cameras": []}
    for width, height, fx, fy, cx, cy, distortion in CAMERAS:
        matrix = np.array(((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)))
        coefficients = np.array(distortion)
        depth = rng.uniform(5.0, 200.0, 20)
        reach = 0.5 * np.array((width / fx, height / fy))
        points = np.column_stack((rng.uniform(-1.0, 1.0, (20, 2)) * reach * depth[:, np.newaxis], depth))
        pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, coefficients)
        uv = rng.uniform((0.0, 0.0), (width - 1.0, height - 1.0), (20, 2))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
        ideal = cv2.undistortPointsIter(uv[:, np.newaxis], matrix, coefficients, np.eye(3), np.eye(3), criteria)
        answers["cameras"].append(
            {
                "width_px": width,
                "height_px": height,
                "fx_px": fx,
                "fy_px": fy,
                "cx_px": cx,
                "cy_px": cy,
                "distortion": distortion,
                "points_camera_m": points.tolist(),
                "points_uv_px": pixels[:, 0].tolist(),
                "uv_px": uv.tolist(),
                "ideal_xy": ideal[:, 0].tolist(),
            }
        )
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
