/** From what is known to what is drawn: GeoJSON for each layer. Pure. */

import type { LocatedPixel, StateMessage, Target } from '../api/types';
import { ellipseRing } from '../geo/ellipse';
import { collection, line, point, polygon, type Collection } from '../geo/geojson';
import type { Vehicle } from '../store/mission';
import type { Track } from '../store/tracks';

export function trackFeatures(track: Track, source: 'gps' | 'vision'): Collection {
  return collection(track.pieces().filter((piece) => piece.length > 1).map((piece) => line(piece, { source })));
}

function known(state: StateMessage | null): (StateMessage & { lat_deg: number; lon_deg: number }) | null {
  return state && state.lat_deg !== null && state.lon_deg !== null
    ? (state as StateMessage & { lat_deg: number; lon_deg: number })
    : null;
}

export function ellipseFeatures(vehicle: Vehicle | null): Collection {
  const state = known(vehicle?.state ?? null);
  if (!state?.ellipse95) return collection([]);
  return collection([polygon(ellipseRing(state, state.ellipse95), { mode: state.mode })]);
}

export function footprintFeatures(vehicle: Vehicle | null): Collection {
  const corners = vehicle?.state?.footprint;
  if (!corners || corners.length < 3) return collection([]);
  return collection([polygon(corners.map(([lat_deg, lon_deg]) => ({ lat_deg, lon_deg })), {})]);
}

/** The selected vehicle's symbol comes last, so that it lies on top. */
export function vehicleFeatures(vehicles: readonly Vehicle[], selected: string | null): Collection {
  const ordered = [...vehicles].sort((a, b) => Number(a.id === selected) - Number(b.id === selected));
  return collection(
    ordered.flatMap((vehicle) => {
      const state = known(vehicle.state);
      if (!state) return [];
      const properties = {
        heading_deg: state.heading_deg ?? 0,
        mode: state.mode,
        selected: vehicle.id === selected,
        label: vehicle.id,
      };
      return [point(state, properties, vehicle.id)];
    }),
  );
}

/** Where GPS says the vehicle is: worth a mark of its own, because it may disagree. */
export function gpsFeatures(vehicle: Vehicle | null): Collection {
  const gps = vehicle?.gps;
  if (!gps || gps.fix_type < 2 || gps.lat_deg === null || gps.lon_deg === null) return collection([]);
  return collection([point({ lat_deg: gps.lat_deg, lon_deg: gps.lon_deg }, { used: gps.used })]);
}

export function targetFeatures(targets: readonly Target[], selected: string | null): Collection {
  return collection(
    targets.map((target) =>
      point(target.properties, { name: target.properties.name, selected: target.id === selected }, target.id),
    ),
  );
}

/** Where followed targets were. */
export function targetTrackFeatures(targets: readonly Target[], trackOf: (id: string) => Track | null): Collection {
  return collection(
    targets.flatMap(({ id }) => (trackOf(id)?.pieces() ?? []).filter((piece) => piece.length > 1).map((piece) => line(piece, { id }))),
  );
}

export function targetEllipseFeatures(targets: readonly Target[], selected: string | null): Collection {
  return collection(
    targets.flatMap((target) => {
      const { ellipse95 } = target.properties;
      if (!ellipse95) return [];
      return [polygon(ellipseRing(target.properties, ellipse95), { selected: target.id === selected })];
    }),
  );
}

/** What the crosshair lies on. */
export function aimFeatures(place: LocatedPixel | null): { mark: Collection; ellipse: Collection } {
  if (!place) return { mark: collection([]), ellipse: collection([]) };
  return { mark: collection([point(place, {})]), ellipse: collection([polygon(ellipseRing(place, place.ellipse95), {})]) };
}
