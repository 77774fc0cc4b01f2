/** While it lives a click on the map gives a place, and picks no target. */

import type { MapBrowserEvent } from 'ol';
import { unByKey } from 'ol/Observable';
import { toLonLat } from 'ol/proj';
import type { LatLon } from '../geo/earth';
import { latLon } from '../geo/geojson';
import type { Chart } from './chart';

export class ClickTool {
  private readonly key;

  constructor(private readonly chart: Chart, placed: (at: LatLon) => void) {
    chart.toolsAtClicks += 1;
    chart.zoomsByDoubleClick(false);
    this.cursor('crosshair');
    this.key = chart.canvas.on('click', (event: MapBrowserEvent) => placed(latLon(toLonLat(event.coordinate))));
  }

  close(): void {
    unByKey(this.key);
    this.cursor('');
    // The same click still comes as a single one, a quarter of a second later.
    setTimeout(() => {
      this.chart.toolsAtClicks -= 1;
      this.chart.zoomsByDoubleClick(true);
    }, 400);
  }

  private cursor(name: string): void {
    const element = this.chart.canvas.getViewport();
    if (element) element.style.cursor = name;
  }
}
