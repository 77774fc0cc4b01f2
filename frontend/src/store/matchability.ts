/** What the matchability layer says of a map, in words, with its colours named. Pure. */

import type { Matchability } from '../api/types';
import { formatLength, METRIC, type Units } from '../geo/units';

export function matchabilityWords(found: Matchability, units: Units = METRIC): string {
  const percent = (share: number) => `${Math.round(100 * share)} %`;
  const sigma = found.median_sigma_m === null ? 'unknown' : formatLength(found.median_sigma_m, units, 1);
  return (
    `For pictures ${formatLength(found.footprint_m, units)} wide, within ${formatLength(found.radius_m, units)}: median sigma ${sigma}. ` +
    `Green (${formatLength(0.5, units, 1)}) to red (${formatLength(10, units)}): ${percent(found.share_good)}. ` +
    `Violet, repeats itself: ${percent(found.share_ambiguous)}. Grey, too little texture: ${percent(found.share_weak)}.`
  );
}
