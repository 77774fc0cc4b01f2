"""The table ``followed.csv`` of a recorded flight: what every picture showed of every target that was followed."""

from __future__ import annotations

from dataclasses import dataclass

from geodata.flight_write import Cell

FOLLOWED_COLUMNS = (
    "time_us", "target", "status", "reason", "u_px", "v_px", "confidence", "seen_us", "lat_deg", "lon_deg",
    "alt_amsl_m", "std_n_m", "std_e_m", "cov_ne_m2", "moving", "vel_n_m_s", "vel_e_m_s",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FollowedRow:
    """One line: frame time and pixel of the recorded video as in ``clicks.csv``, and the place of the last sighting."""

    t_us: int
    target: str
    status: str
    reason: str | None
    uv_px: tuple[float, float] | None
    confidence: float | None
    seen_us: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    std_ne_m: tuple[float, float]
    cov_ne_m2: float
    moving: bool | None
    vel_ne_m_s: tuple[float, float]

    def cells(self) -> tuple[Cell, ...]:
        """As `FOLLOWED_COLUMNS`; empty where nothing is known."""
        u_px, v_px = ("", "") if self.uv_px is None else (f"{value:.2f}" for value in self.uv_px)
        return (
            self.t_us, self.target, self.status, self.reason or "", u_px, v_px,
            "" if self.confidence is None else f"{self.confidence:.3f}", self.seen_us, f"{self.lat_deg:.8f}",
            f"{self.lon_deg:.8f}", f"{self.alt_amsl_m:.2f}", *(f"{std:.3f}" for std in self.std_ne_m),
            f"{self.cov_ne_m2:.4f}", "" if self.moving is None else int(self.moving),
            *(f"{vel:.3f}" for vel in self.vel_ne_m_s),
        )  # fmt: skip
