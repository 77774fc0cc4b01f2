import { describe, expect, it } from 'vitest';
import { matchabilityWords } from './matchability';

const FOUND = {
  map_id: 'a',
  footprint_m: 100,
  radius_m: 40,
  step_m: 25,
  places: 3132,
  median_sigma_m: 1.32,
  share_good: 0.914,
  share_ambiguous: 0.05,
  share_weak: 0.036,
};

describe('matchabilityWords', () => {
  it('names every colour with its share', () => {
    const words = matchabilityWords(FOUND);
    expect(words).toContain('100 m wide, within 40 m');
    expect(words).toContain('median sigma 1.3 m');
    expect(words).toContain('red (10 m): 91 %');
    expect(words).toContain('repeats itself: 5 %');
    expect(words).toContain('too little texture: 4 %');
  });

  it('admits that nothing is known', () => {
    expect(matchabilityWords({ ...FOUND, median_sigma_m: null, places: 0 })).toContain('median sigma unknown');
  });
});
