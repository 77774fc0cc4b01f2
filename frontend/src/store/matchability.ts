/** What the matchability layer says of a map, in words, with its colours named. Pure. */

import type { Matchability } from '../api/types';
import { formatNumber } from '../geo/format';

export function matchabilityWords(found: Matchability): string {
  const percent = (share: number) => `${Math.round(100 * share)} %`;
  const sigma = found.median_sigma_m === null ? 'unknown' : `${formatNumber(found.median_sigma_m, 1)} m`;
  return (
    `For pictures ${formatNumber(found.footprint_m, 0)} m wide, within ${formatNumber(found.radius_m, 0)} m: median sigma ${sigma}. ` +
    `Green (0.5 m) to red (10 m): ${percent(found.share_good)}. ` +
    `Violet, repeats itself: ${percent(found.share_ambiguous)}. Grey, too little texture: ${percent(found.share_weak)}.`
  );
}
