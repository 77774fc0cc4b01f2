/** Draws a video frame on the map, triangle by triangle. */

import ImageLayer from 'ol/layer/Image';
import { fromLonLat } from 'ol/proj';
import ImageCanvas from 'ol/source/ImageCanvas';
import type { Footprint } from '../api/types';
import { position } from '../geo/geojson';
import { affine, trianglesOf, type Point, type Triangle } from './drape';

/** Clipped edges are half transparent: without an overlap the ground would shine through between triangles. */
const OVERLAP_PX = 0.6;

export interface Draped {
  picture: HTMLCanvasElement;
  grid: Footprint;
}

export class DrapeLayer {
  readonly layer: ImageLayer<ImageCanvas>;
  private triangles: Triangle[] = [];
  private picture: HTMLCanvasElement | null = null;
  private readonly canvas = document.createElement('canvas');

  constructor() {
    const source = new ImageCanvas({
      ratio: 1,
      canvasFunction: (extent, resolution, pixelRatio, size) => this.drawn(extent, resolution / pixelRatio, size),
    });
    this.layer = new ImageLayer({ source, zIndex: 90, opacity: 0.7 });
  }

  show(draped: Draped | null, opacity: number): void {
    this.picture = draped?.picture ?? null;
    this.triangles = draped ? trianglesOf(draped.grid) : [];
    this.layer.setOpacity(opacity);
    this.layer.setVisible(draped !== null);
    this.layer.getSource()?.changed();
  }

  private drawn(extent: number[], resolution_m: number, size: number[]): HTMLCanvasElement {
    const { canvas, picture } = this;
    canvas.width = Math.round(size[0]!);
    canvas.height = Math.round(size[1]!);
    const context = canvas.getContext('2d');
    if (!context || !picture) return canvas;
    for (const corners of this.triangles) {
      const on = corners.map((corner): Point => {
        const [east, north] = fromLonLat(position(corner)) as [number, number];
        return { x: (east - extent[0]!) / resolution_m, y: (extent[3]! - north) / resolution_m };
      }) as [Point, Point, Point];
      const map = affine(corners, on);
      if (!map) continue;
      context.save();
      context.beginPath();
      const middle = { x: (on[0].x + on[1].x + on[2].x) / 3, y: (on[0].y + on[1].y + on[2].y) / 3 };
      on.forEach((p, i) => {
        const away = Math.max(1, Math.hypot(p.x - middle.x, p.y - middle.y));
        const x = p.x + ((p.x - middle.x) / away) * OVERLAP_PX;
        const y = p.y + ((p.y - middle.y) / away) * OVERLAP_PX;
        if (i === 0) context.moveTo(x, y);
        else context.lineTo(x, y);
      });
      context.closePath();
      context.clip();
      context.setTransform(...map);
      context.drawImage(picture, 0, 0);
      context.restore();
    }
    return canvas;
  }
}
