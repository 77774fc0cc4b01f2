/** Where on the video a pointer is, when the picture is fitted into its box with bars at two sides. Pure. */

export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

export interface Size {
  width: number;
  height: number;
}

export interface Pixel {
  u_px: number;
  v_px: number;
}

/** The largest box of the picture's shape inside a box, centred: what CSS calls `object-fit: contain`. */
export function fitInside(box: Box, picture: Size): Box & { scale: number } {
  const scale = Math.min(box.width / picture.width, box.height / picture.height);
  const width = picture.width * scale;
  const height = picture.height * scale;
  return {
    left: box.left + (box.width - width) / 2,
    top: box.top + (box.height - height) / 2,
    width,
    height,
    scale,
  };
}

/** Pixel (0, 0) is the centre of the top-left pixel, so its area reaches from -0.5 to 0.5. Null on the bars. */
export function pixelAt(x: number, y: number, box: Box, picture: Size): Pixel | null {
  if (!(picture.width > 0 && picture.height > 0 && box.width > 0 && box.height > 0)) return null;
  const fit = fitInside(box, picture);
  const u_px = (x - fit.left) / fit.scale - 0.5;
  const v_px = (y - fit.top) / fit.scale - 0.5;
  const inside = u_px >= -0.5 && v_px >= -0.5 && u_px < picture.width - 0.5 && v_px < picture.height - 0.5;
  return inside ? { u_px, v_px } : null;
}

/** The inverse: where a pixel's centre is drawn, in the box's coordinates. */
export function pointOf(pixel: Pixel, box: Box, picture: Size): { x: number; y: number } {
  const fit = fitInside(box, picture);
  return { x: fit.left + (pixel.u_px + 0.5) * fit.scale, y: fit.top + (pixel.v_px + 0.5) * fit.scale };
}

/** A pixel moved by an arrow key, held inside the picture; null where the key is no arrow. */
export function movedBy(pixel: Pixel, key: string, step_px: number, picture: Size): Pixel | null {
  const along = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
  if (!along) return null;
  const held = (value: number, size: number) => Math.min(Math.max(value, 0), size - 1);
  return {
    u_px: held(pixel.u_px + along[0]! * step_px, picture.width),
    v_px: held(pixel.v_px + along[1]! * step_px, picture.height),
  };
}
