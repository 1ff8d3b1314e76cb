// A pendulum in closed loop about its trajectory, pushed: lumbar.lifting.stability's equations and its Runge-Kutta step, knot by knot.
"use strict";
window.lumbarPendulum = (() => {
  // loop: constants and columns of lumbar.publishing.lift_page.lift_data; point: of the grid, two to a knot.

  function feedback(loop, point, e, w) {
    return -(loop.s12[point] * e + loop.s22[point] * w) / (loop.inertia * loop.control_weight);
  }

  // Torque that is applied about the pivot, in N·m.
  function torque(loop, point, e, w, limited) {
    const wanted = loop.torque[point] + feedback(loop, point, e, w);
    return limited ? Math.min(Math.max(wanted, loop.lowest), loop.highest) : wanted;
  }

  // Angular acceleration of the error: gravity's change is written without cancellation for small errors.
  function acceleration(loop, point, e, w, limited) {
    const angle = loop.angle[point];
    const sine = e * Math.cos(angle) + Math.cos(angle) * (Math.sin(e) - e) - 2 * Math.sin(angle) * Math.sin(e / 2) ** 2;
    const added = limited ? torque(loop, point, e, w, true) - loop.torque[point] : feedback(loop, point, e, w);
    return (added - loop.damping * w - loop.gravity_torque * sine) / loop.inertia;
  }

  // One step of order 4 over two points of the grid; h is negative backward in time.
  function step(loop, point, way, h, [e, w], limited) {
    const a1 = acceleration(loop, point, e, w, limited);
    const [e2, w2] = [e + 0.5 * h * w, w + 0.5 * h * a1];
    const a2 = acceleration(loop, point + way, e2, w2, limited);
    const [e3, w3] = [e + 0.5 * h * w2, w + 0.5 * h * a2];
    const a3 = acceleration(loop, point + way, e3, w3, limited);
    const [e4, w4] = [e + h * w3, w + h * a3];
    const a4 = acceleration(loop, point + 2 * way, e4, w4, limited);
    return [e + (h / 6) * (w + 2 * w2 + 2 * w3 + w4), w + (h / 6) * (a1 + 2 * a2 + 2 * a3 + a4)];
  }

  const knots = (loop) => loop.level.length;
  const interval = (loop) => loop.duration / (knots(loop) - 1);

  // States from a knot to the last one: [angle error, velocity error] each.
  function follow(loop, knot, state, limited) {
    const states = [state];
    for (let k = knot; k < knots(loop) - 1; k++) states.push(step(loop, 2 * k, 1, interval(loop), states[k - knot], limited));
    return states;
  }

  function ellipse(loop, knot, level, count) {
    const [s11, s12, s22] = [loop.s11[2 * knot], loop.s12[2 * knot], loop.s22[2 * knot]];
    const [root, determinant] = [Math.sqrt(level), s11 * s22 - s12 * s12];
    return Array.from({ length: count }, (_, i) => {
      const [c, s] = [Math.cos((2 * Math.PI * i) / count), Math.sin((2 * Math.PI * i) / count)];
      return [root * Math.sqrt(s22 / determinant) * c, root * (s / Math.sqrt(s22) - (s12 / Math.sqrt(s22 * determinant)) * c)];
    });
  }

  // All states from which the simulated loop ends in the goal set: its edge followed backward; one outline per knot.
  function reached(loop, limited, count) {
    const last = knots(loop) - 1;
    const outlines = new Array(last + 1);
    outlines[last] = ellipse(loop, last, loop.level[last], count);
    for (let k = last; k > 0; k--) {
      outlines[k - 1] = outlines[k].map((state) => step(loop, 2 * k, -1, -interval(loop), state, limited));
    }
    return outlines;
  }

  // V/ρ: below 1 inside the funnel.
  function level(loop, knot, [e, w]) {
    const point = 2 * knot;
    return (loop.s11[point] * e * e + 2 * loop.s12[point] * e * w + loop.s22[point] * w * w) / loop.level[knot];
  }

  return { follow, reached, ellipse, level, torque };
})();
