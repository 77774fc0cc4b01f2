/** Colours and strokes of the map, and the legend that explains them. */

import { Circle, Fill, Icon, RegularShape, Stroke, Style, Text } from 'ol/style';
import type { FeatureLike } from 'ol/Feature';

export const COLOURS = {
  vision: '#2fe0d0',
  gps: '#ffb02e',
  footprint: '#f4f7fa',
  target: '#ff6b9a',
  aim: '#fff14d',
  casing: 'rgba(6, 10, 14, 0.75)',
} as const;

const MODE_COLOURS: Record<string, string> = {
  gps: COLOURS.vision,
  vision: COLOURS.vision,
  dead_reckoning: '#ffd24a',
  lost: '#ff5a4f',
};

const LABEL_FONT = '600 12px system-ui, sans-serif';

function cased(colour: string, width: number, lineDash?: number[]): Style[] {
  const dash = lineDash ? { lineDash } : {};
  return [
    new Style({ stroke: new Stroke({ color: COLOURS.casing, width: width + 2 }) }),
    new Style({ stroke: new Stroke({ color: colour, width, ...dash }) }),
  ];
}

// Dashes as well as colour, so that the two tracks differ for every eye.
export const GPS_TRACK = cased(COLOURS.gps, 2, [7, 5]);
export const VISION_TRACK = cased(COLOURS.vision, 2.5);
export const TARGET_TRACK = cased(COLOURS.target, 2);

export const FOOTPRINT = new Style({
  stroke: new Stroke({ color: COLOURS.footprint, width: 1.25, lineDash: [4, 4] }),
  fill: new Fill({ color: 'rgba(244, 247, 250, 0.06)' }),
});

function ellipse(colour: string): Style {
  return new Style({ stroke: new Stroke({ color: colour, width: 1.75 }), fill: new Fill({ color: `${colour}22` }) });
}

const ELLIPSES = new Map(Object.entries(MODE_COLOURS).map(([mode, colour]) => [mode, ellipse(colour)]));
const UNKNOWN_ELLIPSE = ellipse(COLOURS.vision);

export function ellipseStyle(feature: FeatureLike): Style {
  return ELLIPSES.get(String(feature.get('mode'))) ?? UNKNOWN_ELLIPSE;
}

const TARGET_ELLIPSE = ellipse(COLOURS.target);
const SELECTED_TARGET_ELLIPSE = ellipse('#ffffff');

export function targetEllipseStyle(feature: FeatureLike): Style {
  return feature.get('selected') ? SELECTED_TARGET_ELLIPSE : TARGET_ELLIPSE;
}

// Dashed, because nothing of it is kept.
export const AIM_ELLIPSE = [
  new Style({ stroke: new Stroke({ color: COLOURS.casing, width: 3.5 }) }),
  new Style({ stroke: new Stroke({ color: COLOURS.aim, width: 1.75, lineDash: [5, 3] }) }),
];
export const AIM_MARK = [4, 1.75].map(
  (width, i) =>
    new Style({
      image: new RegularShape({ points: 4, radius: 7, radius2: 0, angle: Math.PI / 4, stroke: new Stroke({ color: i ? COLOURS.aim : COLOURS.casing, width }) }),
    }),
);

export const GPS_MARK = [
  new Style({
    image: new Circle({ radius: 5, stroke: new Stroke({ color: COLOURS.casing, width: 4 }) }),
  }),
  new Style({
    image: new Circle({ radius: 5, stroke: new Stroke({ color: COLOURS.gps, width: 2 }) }),
  }),
];

/** An arrow head that points up at heading zero; drawn here, so that the page needs no file. */
function arrow(fill: string, selected: boolean): string {
  const stroke = selected ? '#ffffff' : '#0a0f14';
  return (
    'data:image/svg+xml;utf8,' +
    encodeURIComponent(
      `<svg xmlns="http://www.w3.org/2000/svg" width="28" height="28" viewBox="-18 -18 36 36">` +
        `<path d="M0 -15 L10 12 L0 6.5 L-10 12 Z" fill="${fill}" stroke="#06090d" stroke-width="4" stroke-linejoin="round"/>` +
        `<path d="M0 -15 L10 12 L0 6.5 L-10 12 Z" fill="${fill}" stroke="${stroke}" stroke-width="1.5" stroke-linejoin="round"/>` +
        `</svg>`,
    )
  );
}

const ARROWS = new Map<string, string>();

export function vehicleStyle(feature: FeatureLike): Style {
  const mode = String(feature.get('mode'));
  const selected = Boolean(feature.get('selected'));
  const key = `${mode}/${selected}`;
  let src = ARROWS.get(key);
  if (src === undefined) {
    src = arrow(MODE_COLOURS[mode] ?? '#cccccc', selected);
    ARROWS.set(key, src);
  }
  const rotation = (Number(feature.get('heading_deg')) * Math.PI) / 180;
  return new Style({ image: new Icon({ src, rotation, rotateWithView: true }), zIndex: selected ? 2 : 1 });
}

export function targetStyle(feature: FeatureLike): Style[] {
  const selected = Boolean(feature.get('selected'));
  const colour = selected ? '#ffffff' : COLOURS.target;
  const cross = (width: number, color: string) =>
    new Style({
      image: new RegularShape({ points: 4, radius: 9, radius2: 0, stroke: new Stroke({ color, width }) }),
    });
  const label = new Style({
    text: new Text({
      text: String(feature.get('name') ?? ''),
      font: LABEL_FONT,
      offsetX: 12,
      textAlign: 'left',
      fill: new Fill({ color: colour }),
      stroke: new Stroke({ color: '#06090d', width: 3.5 }),
    }),
  });
  return [cross(4, COLOURS.casing), cross(2, colour), label];
}
