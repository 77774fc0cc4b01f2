/** A layer for the place to go to or the way there, over everything else. */

import type { FeatureLike } from 'ol/Feature';
import GeoJSON from 'ol/format/GeoJSON';
import VectorLayer from 'ol/layer/Vector';
import type OlMap from 'ol/Map';
import VectorSource from 'ol/source/Vector';
import { Circle, Stroke, Style } from 'ol/style';
import type { Collection } from '../geo/geojson';
import { COLOURS } from './styles';

const COLOUR = '#7fd1ff';
const MARK = [5, 2.5].map(
  (width, i) => new Style({ image: new Circle({ radius: 7, stroke: new Stroke({ color: i ? COLOUR : COLOURS.casing, width }) }) }),
);
const ORBIT = [
  new Style({ stroke: new Stroke({ color: COLOURS.casing, width: 3 }) }),
  new Style({ stroke: new Stroke({ color: COLOUR, width: 1.5, lineDash: [2, 5] }) }),
];

const WAY = [
  new Style({ stroke: new Stroke({ color: COLOURS.casing, width: 5 }) }),
  new Style({ stroke: new Stroke({ color: COLOUR, width: 2.5, lineDash: [10, 5] }) }),
];
const STYLES: Record<string, Style[]> = { orbit: ORBIT, way: WAY };

export class FlyLayer {
  private readonly source = new VectorSource({ useSpatialIndex: false });
  private readonly layer = new VectorLayer({
    source: this.source,
    style: (feature: FeatureLike) => STYLES[String(feature.get('kind'))] ?? MARK,
    zIndex: 140,
    updateWhileInteracting: true,
  });
  private readonly format = new GeoJSON({ featureProjection: 'EPSG:3857' });

  constructor(private readonly map: OlMap) {
    map.addLayer(this.layer);
  }

  draw(features: Collection): void {
    this.source.clear(true);
    this.source.addFeatures(this.format.readFeatures(features));
  }

  close(): void {
    this.map.removeLayer(this.layer);
  }
}
