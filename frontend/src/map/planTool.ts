/** Layers of a plan, and what the pointer does with it while it is edited. It knows nothing of the station. */

import type { MapBrowserEvent } from 'ol';
import GeoJSON from 'ol/format/GeoJSON';
import PointerInteraction from 'ol/interaction/Pointer';
import VectorLayer from 'ol/layer/Vector';
import { unByKey } from 'ol/Observable';
import { fromLonLat, toLonLat } from 'ol/proj';
import VectorSource from 'ol/source/Vector';
import type { LatLon } from '../geo/earth';
import { latLon, position, type Collection } from '../geo/geojson';
import { pixelsFrom, type Edge, type Handle, type Placed } from '../store/handles';
import type { Chart } from './chart';
import { planStyle } from './planStyles';

const GRASP_PX = 13;
const EDGE_PX = 7;
/** A hand that clicks is not quite still. */
const STILL_PX = 4;

export interface PlanListener {
  handles(): Placed[];
  edges(): Edge[];
  /** Whether a click on a leg makes a point there. */
  inserts(): boolean;
  clicked(at: LatLon): void;
  picked(handle: Handle): void;
  /** A handle is on its way; nothing is changed yet. */
  dragging(handle: Handle, at: LatLon): void;
  dropped(handle: Handle, at: LatLon): void;
  inserted(edge: Edge, at: LatLon): void;
}

function layer(zIndex: number): { source: VectorSource; layer: VectorLayer } {
  const source = new VectorSource({ useSpatialIndex: false });
  return { source, layer: new VectorLayer({ source, style: planStyle, zIndex, updateWhileInteracting: true, updateWhileAnimating: true }) };
}

export class PlanLayers {
  private readonly path = layer(131);
  private readonly plan = layer(132);
  private readonly format = new GeoJSON({ featureProjection: 'EPSG:3857' });

  constructor(private readonly chart: Chart) {
    for (const { layer } of [this.path, this.plan]) chart.canvas.addLayer(layer);
  }

  drawPath(features: Collection): void {
    this.put(this.path.source, features);
  }

  drawPlan(features: Collection): void {
    this.put(this.plan.source, features);
  }

  close(): void {
    for (const { layer } of [this.path, this.plan]) this.chart.canvas.removeLayer(layer);
  }

  private put(source: VectorSource, features: Collection): void {
    source.clear(true);
    source.addFeatures(this.format.readFeatures(features));
  }
}

export class PlanTool {
  private readonly interaction: PointerInteraction;
  private readonly key;
  private held: { handle: Handle; from: number[]; moved: boolean } | { edge: Edge; from: number[]; moved: boolean } | null = null;
  private ignoreClick = false;

  constructor(private readonly chart: Chart, private readonly listener: PlanListener, private readonly cursor: string) {
    chart.toolsAtClicks += 1;
    // Without a tool of its own the map behaves as ever.
    chart.zoomsByDoubleClick(cursor === '');
    this.style(cursor);
    this.interaction = new PointerInteraction({
      handleDownEvent: (event) => this.down(event),
      handleDragEvent: (event) => this.drag(event),
      handleUpEvent: (event) => this.up(event),
      handleMoveEvent: (event) => this.hover(event),
    });
    chart.canvas.addInteraction(this.interaction);
    this.key = chart.canvas.on('click', (event: MapBrowserEvent) => {
      if (!this.ignoreClick) listener.clicked(this.at(event));
      this.ignoreClick = false;
    });
  }

  close(): void {
    unByKey(this.key);
    this.chart.canvas.removeInteraction(this.interaction);
    this.style('');
    this.chart.zoomsByDoubleClick(true);
    setTimeout(() => (this.chart.toolsAtClicks -= 1), 400);
  }

  private down(event: MapBrowserEvent): boolean {
    this.ignoreClick = false;
    const from = [...event.pixel];
    const handle = this.handleAt(from);
    const edge = handle ? null : this.edgeAt(from);
    this.held = handle ? { handle, from, moved: false } : edge ? { edge, from, moved: false } : null;
    return this.held !== null;
  }

  private drag(event: MapBrowserEvent): void {
    const { held } = this;
    if (!held) return;
    const [x = 0, y = 0] = event.pixel;
    held.moved ||= Math.hypot(x - held.from[0]!, y - held.from[1]!) > STILL_PX;
    if (held.moved && 'handle' in held) this.listener.dragging(held.handle, this.at(event));
  }

  private up(event: MapBrowserEvent): boolean {
    const { held } = this;
    this.held = null;
    this.ignoreClick = held !== null;
    if (!held) return false;
    const at = this.at(event);
    if ('edge' in held) this.listener.inserted(held.edge, at);
    else if (held.moved) this.listener.dropped(held.handle, at);
    else this.listener.picked(held.handle);
    return false;
  }

  private hover(event: MapBrowserEvent): void {
    const pixel = [...event.pixel];
    this.style(this.handleAt(pixel) ? 'grab' : this.edgeAt(pixel) ? 'copy' : this.cursor);
  }

  private handleAt(pixel: number[]): Handle | null {
    let best: Handle | null = null;
    let least = GRASP_PX;
    for (const { handle, at } of this.listener.handles()) {
      const there = this.pixel(at);
      const off = there ? Math.hypot(there[0]! - pixel[0]!, there[1]! - pixel[1]!) : Infinity;
      if (off <= least) [best, least] = [handle, off];
    }
    return best;
  }

  private edgeAt(pixel: number[]): Edge | null {
    if (!this.listener.inserts()) return null;
    for (const edge of this.listener.edges()) {
      const [a, b] = [this.pixel(edge.from), this.pixel(edge.to)];
      if (a && b && pixelsFrom(pixel, a, b) <= EDGE_PX) return edge;
    }
    return null;
  }

  private pixel(at: LatLon): number[] | null {
    return this.chart.canvas.getPixelFromCoordinate(fromLonLat(position(at)));
  }

  private at(event: MapBrowserEvent): LatLon {
    return latLon(toLonLat(event.coordinate));
  }

  private style(cursor: string): void {
    const element = this.chart.canvas.getViewport();
    if (element) element.style.cursor = cursor;
  }
}
