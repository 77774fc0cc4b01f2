"""Write fixed_wing_scipy.json: flights of Kaiser's Osprey (2008) as SciPy's DOP853 integrates them.

The equations are (2-5) to (2-12) with Euler angles, with numbers that are read off (2-13), (2-14) once more; the
aerodynamic model (squares of the airspeed, drag by the square of the angle of attack) is stated in the docstring of
``simulator/vehicles/airframes.py``.
"""

import json
from pathlib import Path

import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

G, V0 = 9.81, 25.0
DEG = np.degrees(1.0)
A_LON = np.array([[-0.15, 11.08, 0.08], [-0.03, -7.17, 0.83], [0.0, -37.35, -9.96]])
A_LAT = np.array([[-0.69, -0.03, -0.99], [-3.13, -12.92, 1.10], [17.03, -0.10, -0.97]])
INERTIA = np.diag((0.824, 1.135, 1.759))
FLIGHTS = [  # wind NED, aileron, elevator, rudder in degrees, thrust in N; the first 0.5 s, and after
    ("elevator", (0, 0, 0), (0, 3, 0, 40), (0, -2, 0, 20)),
    ("aileron and rudder", (0, 0, 0), (4, 0, 3, 31.25), (-4, 0, -3, 31.25)),
    ("all, in wind", (4, -3, 1), (6, 4, -2, 60), (-5, 1, 4, 35)),
]


def slope(state, inputs, wind):
    """Twelve derivatives: position NED, u v w, roll pitch yaw, p q r."""
    velocity, (roll, pitch, yaw), rates = state[3:6], state[6:9], state[9:12]
    aileron, elevator, rudder, thrust = inputs
    ned = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_matrix()
    air = velocity - ned.T @ wind
    speed = np.linalg.norm(air)
    alpha, beta, f = np.arctan2(air[2], air[0]), np.arcsin(air[1] / speed), speed / V0
    p, q, r = rates
    drag_0 = 0.15 * V0 / 2
    lift_0 = G + 1e-4 * V0 * drag_0 / 0.06
    z_alpha = A_LON[1, 1] * V0
    lift = f**2 * (lift_0 - (z_alpha + drag_0) * alpha - 1e-5 * V0 * elevator) - f * (A_LON[1, 2] - 1) * V0 * q
    drag = f**2 * (drag_0 + (lift_0 - A_LON[0, 1]) * alpha + 25.0 * alpha**2)
    side = f**2 * (A_LAT[0, 0] * V0 + drag_0) * beta + f * V0 * (A_LAT[0, 1] * p + (A_LAT[0, 2] + 1) * r)
    force = -drag * air / speed + (lift * np.sin(alpha), side, -lift * np.cos(alpha))
    force += np.array((f * 0.08 * q + f**2 * 3e-3 * elevator + 0.06 * thrust, 0, 1e-4 * V0 * thrust))
    moment = np.array(
        (
            f**2 * (A_LAT[1, 0] * beta + 1.50 * aileron - 0.02 * rudder) + f * (A_LAT[1, 1] * p + A_LAT[1, 2] * r),
            f**2 * (A_LON[2, 1] * alpha + 0.98 * elevator) + f * A_LON[2, 2] * q,
            f**2 * (A_LAT[2, 0] * beta - 0.09 * aileron + 0.17 * rudder) + f * (A_LAT[2, 1] * p + A_LAT[2, 2] * r),
        )
    )
    gyroscopic = np.linalg.solve(INERTIA, np.cross(rates, INERTIA @ rates))
    euler = np.array(
        (
            p + (q * np.sin(roll) + r * np.cos(roll)) * np.tan(pitch),
            q * np.cos(roll) - r * np.sin(roll),
            (q * np.sin(roll) + r * np.cos(roll)) / np.cos(pitch),
        )
    )
    linear = force + ned.T @ (0, 0, G) - np.cross(rates, velocity)
    return np.concatenate((ned @ velocity, linear, euler, moment - gyroscopic))


def main() -> None:
    """Compute and write."""
    flights = []
    for name, wind, first, then in FLIGHTS:
        state, track = np.zeros(12), []
        state[3:6] = np.array((V0, 0, 0)) + wind
        for inputs, seconds in ((first, 0.5), (then, 1.5)):
            t = np.linspace(0, seconds, round(seconds * 10) + 1)
            run = solve_ivp(
                lambda _, at, inputs=inputs, wind=wind: slope(at, inputs, np.array(wind, float)),
                (0, seconds),
                state,
                method="DOP853",
                t_eval=t,
                rtol=1e-11,
                atol=1e-12,
            )
            state = run.y[:, -1]
            track += run.y[:, 1:].T.tolist()
        flights.append(
            {
                "name": name,
                "wind_ned_m_s": wind,
                "first_deg_n": first,
                "then_deg_n": then,
                "every_s": 0.1,
                "states": [[float(f"{x:.10g}") for x in row] for row in track],
            }
        )
    answers = {"source": f"SciPy {scipy.__version__} solve_ivp DOP853", "flights": flights}
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers) + "\n")


if __name__ == "__main__":
    main()
