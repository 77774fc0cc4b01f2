import { expect, test } from 'vitest';
import { KEYMAP } from './keymap';

test('no key stands twice in a group, as the dialog lists them by their keys', () => {
  for (const { title, keys } of KEYMAP) {
    const names = keys.map(([name]) => name);
    expect(new Set(names).size, title).toBe(names.length);
  }
});
