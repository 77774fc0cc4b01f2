import { describe, expect, it } from 'vitest';
import css from './themes.css?raw';

type Rgb = [number, number, number];

/** The variables of each theme; the two light ones inherit what they do not name. */
function themes(text: string): Record<string, Record<string, string>> {
  const found: Record<string, Record<string, string>> = {};
  for (const [, theme, body] of text.matchAll(/:root(?:\[data-theme='(\w+)'\])? \{([^}]*)\}/g)) {
    const own = Object.fromEntries([...body!.matchAll(/(--[\w-]+):\s*([^;]+);/g)].map(([, name, value]) => [name!, value!.trim()]));
    found[theme ?? 'dark'] = { ...found['dark'], ...own };
  }
  return found;
}

function rgb(value: string): Rgb {
  const match = /^#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/i.exec(value);
  if (!match) throw new Error(`${value} is not an opaque colour`);
  return [1, 2, 3].map((i) => parseInt(match[i]!, 16)) as Rgb;
}

/** WCAG 2.2, relative luminance and contrast ratio. */
function luminance(colour: Rgb): number {
  const [r, g, b] = colour.map((part) => {
    const c = part / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  }) as Rgb;
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(a: Rgb, b: Rgb): number {
  const [light, dark] = [luminance(a), luminance(b)].sort((x, y) => y - x) as [number, number];
  return (light + 0.05) / (dark + 0.05);
}

const SURFACES = ['--ground', '--panel', '--raised', '--selected', '--over'];
const ON_SURFACES = ['--text', '--quiet', '--accent', '--good', '--watch', '--bad', '--aim', '--target'];
const WRITTEN: [string, string][] = [
  ...SURFACES.flatMap((surface) => ON_SURFACES.map((ink): [string, string] => [ink, surface])),
  ['--on-pressed', '--pressed'],
  ['--on-warning', '--warning-fill'],
  ['--on-caution', '--caution-fill'],
  ['--on-info', '--info-fill'],
  ['--on-good', '--good-fill'],
  ['--on-stop', '--stop-fill'],
  ['--on-scrim', '--scrim'],
];
// The edges of controls and of what is focused (WCAG 1.4.11).
const DRAWN: [string, string][] = [
  ...SURFACES.flatMap((surface): [string, string][] => [
    ['--line-strong', surface],
    ['--accent', surface],
  ]),
  ['--warning-edge', '--panel'],
  ['--caution-edge', '--panel'],
  ['--info-edge', '--panel'],
  ['--good-edge', '--panel'],
  ['--dial-line', '--dial-sky'],
  ['--dial-line', '--dial-earth'],
];

const THEMES = themes(css);

function below(theme: Record<string, string>, pairs: [string, string][], least: number): string[] {
  return pairs
    .map(([ink, surface]): [string, number] => [`${ink} on ${surface}`, contrast(rgb(theme[ink]!), rgb(theme[surface]!))])
    .filter(([, ratio]) => ratio < least)
    .map(([pair, ratio]) => `${pair}: ${ratio.toFixed(2)}`);
}

describe('contrast', () => {
  it('is computed as WCAG does', () => {
    // 4.48 is the known ratio of #777777 on white, 21 that of black.
    expect(contrast(rgb('#777777'), rgb('#ffffff'))).toBeCloseTo(4.48, 2);
    expect(contrast(rgb('#000000'), rgb('#ffffff'))).toBeCloseTo(21, 10);
  });

  it('is there for three themes', () => {
    expect(Object.keys(THEMES)).toEqual(['dark', 'light', 'sunlight']);
  });

  it.each(['dark', 'light'])('lets what is written in the theme %s be read', (theme) => {
    expect(below(THEMES[theme]!, WRITTEN, 4.5)).toEqual([]);
    expect(below(THEMES[theme]!, DRAWN, 3)).toEqual([]);
  });

  it('is higher in sunlight', () => {
    expect(below(THEMES['sunlight']!, WRITTEN, 7)).toEqual([]);
    expect(below(THEMES['sunlight']!, DRAWN, 3)).toEqual([]);
  });
});

describe('colours', () => {
  const components = import.meta.glob<string>(['./panels/*.svelte', './*.css', '!./themes.css'], { query: '?raw', import: 'default', eager: true });

  it('stand in themes.css alone', () => {
    expect(Object.keys(components).length).toBeGreaterThan(20);
    expect(components['./console.css']).toContain('font');
    const styles = (name: string, text: string) => (name.endsWith('.css') ? text : (/<style>([\s\S]*)<\/style>/.exec(text)?.[1] ?? ''));
    const own = Object.entries(components).flatMap(([name, text]) =>
      [...styles(name, text).matchAll(/#[0-9a-f]{3,8}\b|\brgba?\(/gi)].map(([colour]) => `${name}: ${colour}`),
    );
    expect(own).toEqual([]);
  });

  it('that are used exist', () => {
    const known = new Set(Object.keys(THEMES['dark']!));
    const used = Object.entries(components).flatMap(([name, text]) => [...text.matchAll(/var\((--[\w-]+)/g)].map(([, variable]) => `${name} ${variable}`));
    // Set by the component that uses it.
    const local = ['--hold', '--side'];
    expect(used.filter((one) => !known.has(one.split(' ')[1]!) && !local.includes(one.split(' ')[1]!))).toEqual([]);
  });
});
