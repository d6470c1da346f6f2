"use strict";
// A camera that circles a box, and the gestures that move it. What a page needs to scroll stays the page's: one finger,
// and the wheel until a click into the view.
const orbiting = (() => {
  const FIELD = 0.6;                    // rad, from the view's top to its bottom
  const [LOWEST, HIGHEST] = [-0.1, 1.5];  // rad above the horizon
  const [NEAREST, FARTHEST] = [0.2, 1.5];  // of the distance that shows the whole box
  const FACES = { side: [-Math.PI / 2 + 0.12, 0.22], front: [-0.12, 0.22], top: [-Math.PI / 2, HIGHEST] };
  const DRAG_PX = 4;
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

  function orbit(element, box, changed) {
    const middle = box[0].map((x, k) => (x + box[1][k]) / 2);
    const [wide, deep, high] = box[0].map((x, k) => box[1][k] - x);
    const round = Math.hypot(wide, deep);
    let yaw, pitch, far, at, dragged = false;

    // Distance from which the box fills the view.
    function fit() {
      const [width, height] = [element.clientWidth, element.clientHeight];
      const focal = height / 2 / Math.tan(FIELD / 2);
      const upright = high * Math.cos(pitch) + round * Math.max(Math.sin(pitch), 0);
      return round / 3 + 1.05 * focal * Math.max(upright / height, round / width);
    }

    function face(name) {
      [yaw, pitch] = FACES[name];
      [far, at] = [fit(), [...middle]];
      changed();
    }

    // What view() is computed from, so that a page that is read anew can show the plant as it was.
    const pose = () => ({ yaw, pitch, far, at });
    function take(former) {
      ({ yaw, pitch, far, at } = former);
      changed();
    }

    function turn(right, up) {
      yaw -= right;
      pitch = clamp(pitch + up, LOWEST, HIGHEST);
      changed();
    }

    function view() {
      const forward = [-Math.cos(pitch) * Math.cos(yaw), -Math.cos(pitch) * Math.sin(yaw), -Math.sin(pitch)];
      const right = [-Math.sin(yaw), Math.cos(yaw), 0];
      const down = [
        forward[1] * right[2] - forward[2] * right[1],
        forward[2] * right[0] - forward[0] * right[2],
        forward[0] * right[1] - forward[1] * right[0],
      ];
      const [width, height] = [element.clientWidth, element.clientHeight];
      const focal = height / 2 / Math.tan(FIELD / 2);
      return { axes: [right, down, forward], eye: at.map((x, k) => x - far * forward[k]), focal, width, height, far, pitch };
    }

    function shift(right, down) {
      const { axes, focal } = view();
      at = at.map((x, k) => clamp(x - (right * axes[0][k] + down * axes[1][k]) * far / focal, box[0][k], box[1][k]));
      changed();
    }

    // Come closer by a factor while what is under the pointer stays there; whether there was room to.
    function zoom(factor, x = element.clientWidth / 2, y = element.clientHeight / 2) {
      const before = far;
      far = clamp(far * factor, NEAREST * fit(), FARTHEST * fit());
      const kept = 1 - before / far;
      shift((x - element.clientWidth / 2) * kept, (y - element.clientHeight / 2) * kept);
      if (far > before) {
        const home = clamp(far / fit() - 0.4, 0, 1);
        at = at.map((value, k) => value + home * (middle[k] - value));
      }
      return Math.abs(far / before - 1) > 1e-6;
    }

    function place(event) {
      const corner = element.getBoundingClientRect();
      return [event.clientX - corner.x, event.clientY - corner.y];
    }

    // ------------------------------------------------------------ mouse and pen
    let pressed;
    element.addEventListener("pointerdown", event => {
      dragged = false;
      if (event.pointerType !== "touch") pressed = { from: place(event), at: place(event) };
    });
    element.addEventListener("pointermove", event => {
      if (!pressed) return;
      const now = place(event);
      if (!dragged && Math.hypot(now[0] - pressed.from[0], now[1] - pressed.from[1]) < DRAG_PX) return;
      if (!dragged) element.setPointerCapture(event.pointerId);
      dragged = true;
      const [right, down] = now.map((x, k) => x - pressed.at[k]);
      pressed.at = now;
      if (event.shiftKey) shift(right, down);
      else turn(right * 0.008, down * 0.008);
    });
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => { pressed = undefined; });

    // ------------------------------------------------------------ the wheel, once it is asked for
    const wake = on => element.classList.toggle("awake", on);
    element.addEventListener("click", () => { if (!dragged) wake(true); });
    element.addEventListener("pointerleave", () => wake(false));
    element.addEventListener("wheel", event => {
      if (!element.classList.contains("awake") || event.ctrlKey) return;
      // At its limit the view lets the page scroll on.
      if (zoom(Math.exp(clamp(event.deltaY, -120, 120) * 0.0015), ...place(event))) event.preventDefault();
    }, { passive: false });

    // ------------------------------------------------------------ two fingers
    let pinched;
    function fingers({ touches }) {
      const [a, b] = [...touches].map(place);
      return { middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], apart: Math.hypot(a[0] - b[0], a[1] - b[1]) };
    }
    element.addEventListener("touchstart", event => {
      pinched = event.touches.length === 2 ? fingers(event) : undefined;
      if (pinched && event.cancelable) event.preventDefault();
    }, { passive: false });
    element.addEventListener("touchmove", event => {
      if (!pinched || event.touches.length !== 2 || !event.cancelable) return;
      event.preventDefault();
      const now = fingers(event);
      turn((now.middle[0] - pinched.middle[0]) * 0.008, (now.middle[1] - pinched.middle[1]) * 0.008);
      zoom(pinched.apart / now.apart, ...now.middle);
      pinched = now;
    }, { passive: false });
    element.addEventListener("touchend", () => { pinched = undefined; });

    // ------------------------------------------------------------ keys
    const keys = {
      ArrowLeft: () => turn(-0.12, 0), ArrowRight: () => turn(0.12, 0), ArrowUp: () => turn(0, 0.12), ArrowDown: () => turn(0, -0.12),
      "+": () => zoom(0.85), "-": () => zoom(1 / 0.85), Escape: () => wake(false),
    };
    element.addEventListener("keydown", event => {
      const act = event.target === element && !event.ctrlKey && !event.metaKey && keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });

    return { face, view, place, pose, take, dragged: () => dragged };
  }

  return { orbit };
})();
