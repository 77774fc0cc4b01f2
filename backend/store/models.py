"""The tables. SQLite by default; nothing here is particular to it."""

from __future__ import annotations

from sqlalchemy import BigInteger, Float, Integer, String
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

SCHEMA_VERSION = 2


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
    created_unix_us: Mapped[int] = mapped_column(BigInteger, index=True)
    updated_unix_us: Mapped[int] = mapped_column(BigInteger)
    version: Mapped[int] = mapped_column(Integer)
