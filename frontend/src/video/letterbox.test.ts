import { describe, expect, it } from 'vitest';
import { fitInside, movedBy, pixelAt, pointOf } from './letterbox';

const picture = { width: 640, height: 480 };

describe('pixelAt', () => {
  it('takes the bars at the sides into account', () => {
    const box = { left: 100, top: 50, width: 1000, height: 480 };
    expect(fitInside(box, picture)).toMatchObject({ left: 280, top: 50, width: 640, height: 480, scale: 1 });
    expect(pixelAt(280.5, 50.5, box, picture)).toEqual({ u_px: 0, v_px: 0 });
    expect(pixelAt(279, 200, box, picture)).toBeNull();
    expect(pixelAt(920.5, 200, box, picture)).toBeNull();
  });

  it('takes the bars above and below into account', () => {
    const box = { left: 0, top: 0, width: 320, height: 400 };
    expect(pixelAt(160, 200, box, picture)).toEqual({ u_px: 319.5, v_px: 239.5 });
    expect(pixelAt(160, 79, box, picture)).toBeNull();
    expect(pixelAt(160, 321, box, picture)).toBeNull();
  });

  it('puts the centre of the box on the centre of the picture, whatever the shape', () => {
    for (const [width, height] of [[640, 480], [333, 777], [1920, 200]] as const) {
      const pixel = pixelAt(10 + width / 2, 20 + height / 2, { left: 10, top: 20, width, height }, picture)!;
      expect(pixel.u_px).toBeCloseTo(319.5, 9);
      expect(pixel.v_px).toBeCloseTo(239.5, 9);
    }
  });

  it('goes there and back', () => {
    const box = { left: 13, top: 7, width: 517, height: 291 };
    for (const pixel of [{ u_px: 0, v_px: 0 }, { u_px: 639, v_px: 479 }, { u_px: 123.25, v_px: 400.5 }]) {
      const { x, y } = pointOf(pixel, box, picture);
      const back = pixelAt(x, y, box, picture)!;
      expect(back.u_px).toBeCloseTo(pixel.u_px, 9);
      expect(back.v_px).toBeCloseTo(pixel.v_px, 9);
    }
  });

  it('has no answer without a picture', () => {
    expect(pixelAt(1, 1, { left: 0, top: 0, width: 10, height: 10 }, { width: 0, height: 0 })).toBeNull();
  });
});

describe('movedBy', () => {
  const picture = { width: 640, height: 480 };

  it('moves with the arrow keys and stays in the picture', () => {
    expect(movedBy({ u_px: 10, v_px: 20 }, 'ArrowLeft', 1, picture)).toEqual({ u_px: 9, v_px: 20 });
    expect(movedBy({ u_px: 10, v_px: 20 }, 'ArrowDown', 10, picture)).toEqual({ u_px: 10, v_px: 30 });
    expect(movedBy({ u_px: 3, v_px: 20 }, 'ArrowLeft', 10, picture)).toEqual({ u_px: 0, v_px: 20 });
    expect(movedBy({ u_px: 635.5, v_px: 20 }, 'ArrowRight', 10, picture)).toEqual({ u_px: 639, v_px: 20 });
    expect(movedBy({ u_px: 3, v_px: 478 }, 'ArrowDown', 10, picture)).toEqual({ u_px: 3, v_px: 479 });
  });

  it('leaves other keys alone', () => {
    expect(movedBy({ u_px: 3, v_px: 20 }, 'Enter', 10, picture)).toBeNull();
  });
});
