/** The thin part between our GeoJSON and OpenLayers. It knows nothing of the station. */

import { defaults as defaultControls, ScaleLine } from 'ol/control';
import GeoJSON from 'ol/format/GeoJSON';
import { defaults as defaultInteractions, DoubleClickZoom } from 'ol/interaction';
import PointerInteraction from 'ol/interaction/Pointer';
import TileLayer from 'ol/layer/Tile';
import VectorLayer from 'ol/layer/Vector';
import OlMap from 'ol/Map';
import { fromLonLat, toLonLat, transformExtent } from 'ol/proj';
import VectorSource from 'ol/source/Vector';
import XYZ from 'ol/source/XYZ';
import type { StyleLike } from 'ol/style/Style';
import View from 'ol/View';
import type { MapSummary } from '../api/types';
import type { LatLon } from '../geo/earth';
import type { LengthUnit } from '../geo/units';
import { latLon, position, type Collection } from '../geo/geojson';
import { DrapeLayer, type Draped } from './drapeLayer';
import {
  AIM_ELLIPSE,
  AIM_MARK,
  ellipseStyle,
  FOOTPRINT,
  GPS_MARK,
  GPS_TRACK,
  TARGET_TRACK,
  targetEllipseStyle,
  targetStyle,
  vehicleStyle,
  VISION_TRACK,
} from './styles';
import { zoomForGsd } from './zoom';

export const OVERLAYS = [
  'footprint',
  'gpsTrack',
  'visionTrack',
  'targetTracks',
  'targetEllipses',
  'ellipse',
  'gpsMark',
  'targets',
  'aimEllipse',
  'aim',
  'vehicles',
] as const;
export type Overlay = (typeof OVERLAYS)[number];

/** The page says so on its root, from its settings and from the system's. */
function motionReduced(): boolean {
  return document.documentElement.dataset['motion'] === 'reduced';
}

const STYLES: Record<Overlay, StyleLike> = {
  footprint: FOOTPRINT,
  gpsTrack: GPS_TRACK,
  visionTrack: VISION_TRACK,
  targetTracks: TARGET_TRACK,
  targetEllipses: targetEllipseStyle,
  ellipse: ellipseStyle,
  gpsMark: GPS_MARK,
  targets: targetStyle,
  aimEllipse: AIM_ELLIPSE,
  aim: AIM_MARK,
  vehicles: vehicleStyle,
};

export interface ChartListener {
  pointer(at: LatLon | null): void;
  /** The operator drags the frame that lies on the map, while that may be dragged. */
  layerDragged(from: LatLon, to: LatLon): void;
  /** The operator took hold of the map. */
  dragged(): void;
  targetPicked(id: string): void;
  tileFailed(map_id: string): void;
}

const WEB_MERCATOR = 'EPSG:3857';
/** The 95 % ellipse of a good fix can be seen beside the symbol, and so can what the camera sees. */
const CLOSE_ZOOM = 17.4;

export class Chart {
  private readonly map: OlMap;
  private readonly sources = new Map<Overlay, VectorSource>();
  private readonly layers = new Map<Overlay, VectorLayer>();
  private readonly imagery = new Map<string, TileLayer>();
  private matchability: TileLayer | null = null;
  private readonly scale = new ScaleLine({ units: 'metric', minWidth: 90 });
  private readonly drape = new DrapeLayer();
  private readonly dragging: PointerInteraction;
  private readonly element: HTMLElement;
  /** While a tool takes the clicks, none picks a target. */
  toolsAtClicks = 0;
  private readonly format = new GeoJSON({ featureProjection: WEB_MERCATOR });

  constructor(element: HTMLElement, listener: ChartListener) {
    this.element = element;
    const overlays = OVERLAYS.map((name, i) => {
      const source = new VectorSource({ useSpatialIndex: false });
      const layer = new VectorLayer({
        source,
        style: STYLES[name],
        zIndex: 100 + i,
        updateWhileAnimating: true,
        updateWhileInteracting: true,
      });
      this.sources.set(name, source);
      this.layers.set(name, layer);
      return layer;
    });
    this.map = new OlMap({
      target: element,
      layers: [this.drape.layer, ...overlays],
      controls: defaultControls({ attribution: false, rotate: true }).extend([this.scale]),
      interactions: defaultInteractions({ altShiftDragRotate: true }),
      view: new View({ center: [0, 0], zoom: 2, maxZoom: 23, minZoom: 1, constrainResolution: false }),
    });
    this.map.on('pointermove', (event) => {
      if (!event.dragging) listener.pointer(latLon(toLonLat(event.coordinate)));
    });
    this.map.getViewport()?.addEventListener('pointerleave', () => listener.pointer(null));
    this.map.on('pointerdrag', () => {
      if (!this.dragging.getActive()) listener.dragged();
    });
    this.map.on('singleclick', (event) => {
      if (this.toolsAtClicks > 0) return;
      const layer = this.layers.get('targets');
      const hit = this.map.forEachFeatureAtPixel(event.pixel, (feature) => feature, {
        hitTolerance: 8,
        layerFilter: (candidate) => candidate === layer,
      });
      const id = hit?.getId();
      if (id !== undefined) listener.targetPicked(String(id));
    });
    this.tileFailed = listener.tileFailed;
    let last: number[] | null = null;
    this.dragging = new PointerInteraction({
      handleDownEvent: (event) => {
        last = event.coordinate;
        return true;
      },
      handleDragEvent: (event) => {
        if (last) listener.layerDragged(latLon(toLonLat(last)), latLon(toLonLat(event.coordinate)));
        last = event.coordinate;
      },
    });
    this.dragging.setActive(false);
    this.map.addInteraction(this.dragging);
  }

  /** While on, dragging moves the frame on the map and not the map. */
  dragLaid(on: boolean): void {
    this.dragging.setActive(on);
    this.element.style.cursor = on ? 'move' : '';
  }

  /** For what brings its own layers and tools. */
  get canvas(): OlMap {
    return this.map;
  }

  private readonly tileFailed: (map_id: string) => void;

  close(): void {
    this.map.setTarget(undefined);
    this.map.dispose();
  }

  resize(): void {
    this.map.updateSize();
  }

  /** Two quick clicks zoom in, wherever they are: not while a tool takes each for itself. */
  zoomsByDoubleClick(on: boolean): void {
    for (const one of this.map.getInteractions().getArray()) if (one instanceof DoubleClickZoom) one.setActive(on);
  }

  draw(overlay: Overlay, features: Collection): void {
    const source = this.sources.get(overlay);
    if (!source) return;
    source.clear(true);
    source.addFeatures(this.format.readFeatures(features));
  }

  show(overlay: Overlay, visible: boolean): void {
    this.layers.get(overlay)?.setVisible(visible);
  }

  /** Layers for exactly these maps, the finest on top. */
  setImagery(maps: readonly MapSummary[], tileUrl: (map_id: string) => string): void {
    const wanted = maps.filter((map) => map.kind === 'imagery');
    for (const [id, layer] of this.imagery) {
      if (wanted.some((map) => map.id === id)) continue;
      this.map.removeLayer(layer);
      this.imagery.delete(id);
    }
    const ordered = [...wanted].sort((a, b) => (b.gsd_m ?? Infinity) - (a.gsd_m ?? Infinity));
    ordered.forEach((map, i) => {
      let layer = this.imagery.get(map.id);
      if (!layer) {
        const { west_deg, south_deg, east_deg, north_deg } = map.bounds;
        const source = new XYZ({
          url: tileUrl(map.id),
          minZoom: 0,
          // Beyond the imagery's own resolution the browser enlarges; asking for more tiles would show nothing new.
          maxZoom: zoomForGsd(map.gsd_m ?? 0.5, (south_deg + north_deg) / 2),
          transition: 0,
        });
        source.on('tileloaderror', () => this.tileFailed(map.id));
        layer = new TileLayer({
          source,
          extent: transformExtent([west_deg, south_deg, east_deg, north_deg], 'EPSG:4326', WEB_MERCATOR),
        });
        this.imagery.set(map.id, layer);
        this.map.addLayer(layer);
      }
      layer.setZIndex(i);
    });
  }

  showImagery(visible: boolean): void {
    for (const layer of this.imagery.values()) layer.setVisible(visible);
  }

  /** The layer of one map over all imagery, or none. */
  setMatchability(map: MapSummary | null, tileUrl: (map_id: string) => string): void {
    if (this.matchability) this.map.removeLayer(this.matchability);
    this.matchability = null;
    if (!map) return;
    const { west_deg, south_deg, east_deg, north_deg } = map.bounds;
    this.matchability = new TileLayer({
      // Places are tens of metres apart; finer tiles would show nothing new.
      source: new XYZ({ url: tileUrl(map.id), minZoom: 0, maxZoom: 17, transition: 0 }),
      extent: transformExtent([west_deg, south_deg, east_deg, north_deg], 'EPSG:4326', WEB_MERCATOR),
      opacity: 0.55,
      zIndex: this.imagery.size,
    });
    this.map.addLayer(this.matchability);
  }

  /** A video frame over the imagery and under everything else, or none. */
  lay(draped: Draped | null, opacity: number): void {
    this.drape.show(draped, opacity);
  }

  fitMap(map: MapSummary): void {
    const { west_deg, south_deg, east_deg, north_deg } = map.bounds;
    const extent = transformExtent([west_deg, south_deg, east_deg, north_deg], 'EPSG:4326', WEB_MERCATOR);
    this.map.getView().fit(extent, { padding: [20, 20, 20, 20], size: this.map.getSize() ?? [800, 600] });
  }

  measureIn(length: LengthUnit): void {
    this.scale.setUnits(length === 'ft' ? 'us' : 'metric');
  }

  /** Moves at once when following, smoothly when asked for by hand. */
  centre(at: LatLon, smooth: boolean, close = false): void {
    const view = this.map.getView();
    const center = fromLonLat(position(at));
    const far = (view.getZoom() ?? 0) < (close ? CLOSE_ZOOM : 12);
    const zoom = far ? CLOSE_ZOOM : undefined;
    if (smooth && !motionReduced()) view.animate(zoom === undefined ? { center, duration: 250 } : { center, zoom, duration: 250 });
    else {
      view.setCenter(center);
      if (zoom !== undefined) view.setZoom(zoom);
    }
  }

  zoomBy(steps: number): void {
    const view = this.map.getView();
    view.animate({ zoom: (view.getZoom() ?? 0) + steps, duration: motionReduced() ? 0 : 150 });
  }
}
