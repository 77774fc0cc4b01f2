"""Bytes to and from vehicles over UDP, TCP and serial ports; asyncio, no thought about what the bytes mean."""

from backend.transports.base import Transport, TransportError
from backend.transports.registry import TRANSPORTS, create_transport

__all__ = ["TRANSPORTS", "Transport", "TransportError", "create_transport"]
