"""Prometheus metrics of one station, in a registry of its own."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

_SECONDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)


class Metrics:
    """What the station counts and times. ``stage`` is one step on a frame's way from the wire to the browser."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.stage = Histogram(
            "pilotage_stage_seconds", "Time a stage takes", ["stage"], buckets=_SECONDS, registry=self.registry
        )
        self.packets = Counter(
            "pilotage_link_packets_total", "MAVLink packets received", ["endpoint"], registry=self.registry
        )
        self.noise = Gauge("pilotage_link_noise_bytes", "Bytes between packets", ["endpoint"], registry=self.registry)
        self.frames = Counter(
            "pilotage_video_frames_total", "Video frames received", ["source"], registry=self.registry
        )
        self.fixes = Counter(
            "pilotage_fixes_total",
            "Attempts at position fixes",
            ["vehicle", "kind", "accepted"],
            registry=self.registry,
        )
        self.samples_dropped = Gauge(
            "pilotage_navigator_samples_dropped",
            "Samples the estimator had no time for",
            ["vehicle"],
            registry=self.registry,
        )
        self.frames_dropped = Gauge(
            "pilotage_navigator_frames_dropped",
            "Frames the estimator had no time for",
            ["vehicle"],
            registry=self.registry,
        )
        self.following = Histogram(
            "pilotage_following_seconds",
            "Processor time of looking for a followed target in a picture",
            ["vehicle"],
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.following_dropped = Gauge(
            "pilotage_following_frames_dropped",
            "Frames in which followed targets were not looked for, because too many waited",
            ["vehicle"],
            registry=self.registry,
        )
        self.navigator_failures = Gauge(
            "pilotage_navigator_failures",
            "Times the estimator had to be started anew",
            ["vehicle"],
            registry=self.registry,
        )
        self.clients = Gauge("pilotage_stream_clients", "Open streams", registry=self.registry)
        self.clients_dropped = Counter(
            "pilotage_stream_clients_dropped_total",
            "Streams closed because they were read too slowly",
            registry=self.registry,
        )
        self.cot_events = Counter(
            "pilotage_cot_events_total", "CoT events sent", ["destination"], registry=self.registry
        )
        self.cot_failures = Counter(
            "pilotage_cot_failures_total",
            "Times CoT events did not go out",
            ["destination"],
            registry=self.registry,
        )
        self.cot_dropped = Counter(
            "pilotage_cot_dropped_total",
            "CoT events dropped because too many waited",
            ["destination"],
            registry=self.registry,
        )
        self.recording_bytes = Gauge(
            "pilotage_recording_bytes", "Size of the running recording", registry=self.registry
        )
        self.recording_dropped = Gauge(
            "pilotage_recording_dropped", "Records the disk was too slow for", registry=self.registry
        )
        self.disk_free = Gauge("pilotage_disk_free_bytes", "Space left in the data folder", registry=self.registry)
