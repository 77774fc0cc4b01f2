"""The tables. SQLite by default; nothing here is particular to it."""

from __future__ import annotations

from sqlalchemy import BigInteger, Boolean, Float, Integer, String
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

SCHEMA_VERSION = 3


class Base(DeclarativeBase):
    """Base of all tables."""


class TargetRow(Base):
    """One target; columns as the fields of `backend.store.targets.Target`."""

    __tablename__ = "targets"

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    lat_deg: Mapped[float] = mapped_column(Float)
    lon_deg: Mapped[float] = mapped_column(Float)
    alt_amsl_m: Mapped[float | None] = mapped_column(Float)
    method: Mapped[str] = mapped_column(String(40))
    vehicle_id: Mapped[str | None] = mapped_column(String(200))
    frame_id: Mapped[int | None] = mapped_column(BigInteger)
    t_unix_us: Mapped[int | None] = mapped_column(BigInteger)
    u_px: Mapped[float | None] = mapped_column(Float)
    v_px: Mapped[float | None] = mapped_column(Float)
    var_n_m2: Mapped[float | None] = mapped_column(Float)
    var_e_m2: Mapped[float | None] = mapped_column(Float)
    var_d_m2: Mapped[float | None] = mapped_column(Float)
    cov_ne_m2: Mapped[float | None] = mapped_column(Float)
    height_above_ground_m: Mapped[float | None] = mapped_column(Float)
    ground: Mapped[str | None] = mapped_column(String(20))
    track_status: Mapped[str | None] = mapped_column(String(20))
    track_reason: Mapped[str | None] = mapped_column(String(300))
    seen_unix_us: Mapped[int | None] = mapped_column(BigInteger)
    moving: Mapped[bool | None] = mapped_column(Boolean)
    vel_n_m_s: Mapped[float | None] = mapped_column(Float)
    vel_e_m_s: Mapped[float | None] = mapped_column(Float)
    var_vel_n_m2_s2: Mapped[float | None] = mapped_column(Float)
    var_vel_e_m2_s2: Mapped[float | None] = mapped_column(Float)
    cov_vel_ne_m2_s2: Mapped[float | None] = mapped_column(Float)
    registration: Mapped[str | None] = mapped_column(String(300))
    refined: Mapped[int | None] = mapped_column(Integer)
    created_unix_us: Mapped[int] = mapped_column(BigInteger, index=True)
    updated_unix_us: Mapped[int] = mapped_column(BigInteger)
    version: Mapped[int] = mapped_column(Integer)
