"""Write grid_mgrs.json: grid references of places all over the world as GeoTrans has them."""

import importlib.metadata
import json
import random
from pathlib import Path

import mgrs

# Every exception of the zones, both sides of the equator and of the date line, and the last band.
CORNERS = [
    (60.0, 2.999), (60.0, 3.001), (56.001, 11.999), (63.999, 5.0), (64.001, 5.0), (75.0, 8.999), (75.0, 9.001),
    (75.0, 20.999), (75.0, 21.001), (75.0, 32.999), (75.0, 33.001), (75.0, 41.999), (75.0, 42.001), (0.00001, 179.9999),
    (-0.00001, -179.9999), (83.99, -70.0), (-79.99, 100.0), (71.999, 30.0), (72.001, 30.0),
]  # fmt: skip


def main() -> None:
    """Compute and write."""
    rng = random.Random(11)
    grid = mgrs.MGRS()
    places = CORNERS + [(rng.uniform(-79.9, 83.9), rng.uniform(-180.0, 179.99)) for _ in range(200)]
    answers = {
        "source": f"mgrs {importlib.metadata.version('mgrs')}, which wraps NGA's GeoTrans",
        "places": [
            {
                "lat_deg": lat,
                "lon_deg": lon,
                "mgrs": grid.toMGRS(lat, lon),
                "mgrs_100_m": grid.toMGRS(lat, lon, MGRSPrecision=3),
            }
            for lat, lon in ((round(lat, 6), round(lon, 6)) for lat, lon in places)
        ],
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
