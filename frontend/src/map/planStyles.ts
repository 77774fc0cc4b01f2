/** Colours and strokes of plans. */

import type { FeatureLike } from 'ol/Feature';
import { Circle, Fill, RegularShape, Stroke, Style, Text } from 'ol/style';
import { SPEED_COLOURS } from './planFeatures';
import { COLOURS } from './styles';

const INK = '#06090d';
const POINT = '#f4f7fa';
const CURRENT = '#ff7a1a';
const SELECTED = '#ff8bff';
const KEEP_IN = '#4ccf8a';
const KEEP_OUT = '#ff5a4f';
const FONT = '700 11px system-ui, sans-serif';

function cased(color: string, width: number, lineDash?: number[]): Style[] {
  return [
    new Style({ stroke: new Stroke({ color: COLOURS.casing, width: width + 2.5 }) }),
    new Style({ stroke: new Stroke({ color, width, ...(lineDash ? { lineDash } : {}) }) }),
  ];
}

const PATHS = SPEED_COLOURS.map((colour) => cased(colour, 3.5));
const LEGS = new Style({ stroke: new Stroke({ color: 'rgba(244, 247, 250, 0.45)', width: 1.25, lineDash: [3, 5] }) });
const DRAFT = cased(SELECTED, 1.75, [5, 4]);
// Hatching would cover the ground: a dash tells the two apart for every eye.
const ZONES = {
  in: new Style({ stroke: new Stroke({ color: KEEP_IN, width: 2.25 }), fill: new Fill({ color: 'rgba(76, 207, 138, 0.05)' }) }),
  out: new Style({ stroke: new Stroke({ color: KEEP_OUT, width: 2.25, lineDash: [8, 4] }),
    fill: new Fill({ color: 'rgba(255, 90, 79, 0.18)' }) }),
};
const PROBLEM = new Style({
  image: new RegularShape({
    points: 3, radius: 11, fill: new Fill({ color: KEEP_OUT }), stroke: new Stroke({ color: INK, width: 1.5 }), displacement: [0, 24] }),
  // Above the point that may be at the same place.
  text: new Text({ text: '!', font: FONT, offsetY: -22, fill: new Fill({ color: '#ffffff' }) }),
  zIndex: 3,
});

const made = new Map<string, Style>();

function corner(selected: boolean): Style {
  return new Style({
    image: new RegularShape({
      points: 4, radius: selected ? 8 : 6, angle: Math.PI / 4,
      fill: new Fill({ color: selected ? SELECTED : POINT }), stroke: new Stroke({ color: INK, width: 1.5 }),
    }),
    zIndex: 1,
  });
}

function labelled(kind: string, label: string, selected: boolean, current: boolean): Style {
  const fill = new Fill({ color: selected ? SELECTED : kind === 'rally' ? '#c9a0ff' : kind === 'home' ? '#ffb02e' : POINT });
  const stroke = new Stroke({ color: current ? CURRENT : INK, width: current ? 4 : 1.5 });
  const radius = selected ? 12 : 10;
  return new Style({
    image:
      kind === 'item'
        ? new Circle({ radius, fill, stroke })
        : new RegularShape({ points: kind === 'home' ? 4 : 6, radius, fill, stroke, angle: kind === 'home' ? Math.PI / 4 : 0 }),
    text: new Text({ text: label, font: FONT, offsetY: 1, fill: new Fill({ color: INK }) }),
    zIndex: selected ? 5 : 2,
  });
}

export function planStyle(feature: FeatureLike): Style | Style[] {
  const kind = String(feature.get('kind'));
  const selected = Boolean(feature.get('selected'));
  switch (kind) {
    case 'path':
      return PATHS[Number(feature.get('step'))] ?? PATHS[0]!;
    case 'legs':
      return LEGS;
    case 'draft':
      return DRAFT;
    case 'zone':
      return feature.get('inclusion') ? ZONES.in : ZONES.out;
    case 'problem':
      return PROBLEM;
  }
  const label = String(feature.get('label') ?? '');
  const key = `${kind}/${label}/${selected}/${Boolean(feature.get('current'))}`;
  let style = made.get(key);
  if (!style) {
    style = kind === 'corner' ? corner(selected) : labelled(kind, label, selected, Boolean(feature.get('current')));
    made.set(key, style);
  }
  return style;
}
