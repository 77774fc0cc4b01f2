/** Which files are plans and no maps. Pure. */

export function isPlanFile(name: string): boolean {
  return /\.(plan|waypoints|txt)$/i.test(name);
}
