"""Write earth_pyproj.json: coordinates on WGS-84 as PROJ has them."""

import json
from pathlib import Path

import pyproj

PLACES = [  # latitude, longitude (degrees), ellipsoidal height (metres)
    (0.0, 0.0, 0.0),
    (0.0, 180.0, 100.0),
    (0.0, -90.0, -50.0),
    (90.0, 0.0, 0.0),
    (-90.0, 0.0, 2800.0),
    (89.999999, 45.0, 10.0),
    (45.0, 45.0, 8848.0),
    (58.4108, 15.6214, 152.0),
    (-33.8688, 151.2093, 58.0),
    (37.7749, -122.4194, 16.0),
    (-54.8019, -68.3030, 30.0),
    (12.5, 77.3, 20000.0),
    (-0.000001, -179.999999, 1.0),
    (50.8, -0.13, 400000.0),
]

ORIGINS = [(58.4108, 15.6214, 152.0), (-33.8688, 151.2093, 58.0), (0.0, 0.0, 0.0), (89.9, -120.0, 500.0)]
OFFSETS = [(0.0, 0.0, 0.0), (0.0005, -0.0007, 12.0), (-0.01, 0.02, -130.0), (0.05, 0.05, 900.0), (-0.3, -0.4, 5000.0)]


def main() -> None:
    """Compute and write."""
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    geod = pyproj.Geod(ellps="WGS84")
    answers = {
        "source": f"pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}",
        "ecef": [
            {"lat_deg": lat, "lon_deg": lon, "alt_hae_m": alt, "ecef_m": to_ecef.transform(lon, lat, alt)}
            for lat, lon, alt in PLACES
        ],
        "topocentric": [],
        "arcs": [],
    }
    for lat_0, lon_0, alt_0 in ORIGINS:
        topocentric = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat_0} +lon_0={lon_0} +h_0={alt_0}"
        )
        for d_lat, d_lon, d_alt in OFFSETS:
            lat, lon, alt = lat_0 + d_lat, lon_0 + d_lon, alt_0 + d_alt
            if lat > 90.0:
                continue
            east, north, up = topocentric.transform(lon, lat, alt)
            answers["topocentric"].append(
                {
                    "origin": {"lat_deg": lat_0, "lon_deg": lon_0, "alt_hae_m": alt_0},
                    "lat_deg": lat,
                    "lon_deg": lon,
                    "alt_hae_m": alt,
                    "ned_m": [north, east, -up],
                }
            )
    for lat in (0.0, 20.0, 45.0, 58.4, 80.0, -33.9):
        # Short enough that the arc over the angle is the radius of curvature to 1e-8.
        _, _, north_m = geod.inv(0.0, lat - 0.005, 0.0, lat + 0.005)
        x, y, _ = to_ecef.transform(30.0, lat, 0.0)
        answers["arcs"].append(
            {"lat_deg": lat, "span_deg": 0.01, "meridian_arc_m": north_m, "parallel_radius_m": (x * x + y * y) ** 0.5}
        )
    Path(__file__).with_suffix(".json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
