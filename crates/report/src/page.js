// Reads numbers off the figures, and enlarges a part of one.
"use strict";
for (const svg of document.querySelectorAll("figure svg[data-frame]")) {
  const [left, top, right, bottom] = svg.dataset.frame.split(" ").map(Number);
  const axis = (text) => {
    const [kind, low, high, ...label] = text.split(" ");
    return { log: kind === "log", low: +low, high: +high, label: label.join(" ") };
  };
  const x = axis(svg.dataset.x), y = axis(svg.dataset.y);
  const value = (of, part) => {
    const at = of.low + (of.high - of.low) * part;
    return `${of.label} ${(of.log ? 10 ** at : at).toPrecision(5)}`;
  };
  const whole = svg.ownerSVGElement || svg;
  const figure = svg.closest("figure");
  if (!figure.querySelector("output")) {
    figure.append(document.createElement("output"));
  }
  const output = figure.querySelector("output");
  const place = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const inside = (p) => p.x >= left && p.x <= right && p.y >= top && p.y <= bottom;
  const add = (name) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    made.setAttribute("fill", "none");
    made.setAttribute("stroke", "#22262b");
    made.setAttribute("stroke-width", 12);
    made.setAttribute("visibility", "hidden");
    svg.append(made);
    return made;
  };
  const mark = add("circle"), box = add("rect");
  mark.setAttribute("r", 45);
  // Points of the curves.
  let points;
  const nearest = (p) => {
    points ??= [...svg.querySelectorAll("polyline")].flatMap((line) => [...line.points]).filter(inside);
    let best = null, least = 150;
    for (const q of points) {
      const far = Math.hypot(q.x - p.x, q.y - p.y);
      if (far < least) [best, least] = [q, far];
    }
    return best;
  };
  let from = null;
  svg.addEventListener("pointermove", (event) => {
    const p = place(event);
    if (from) {
      box.setAttribute("visibility", "visible");
      for (const side of ["x", "y"]) box.setAttribute(side, Math.min(from[side], p[side]));
      box.setAttribute("width", Math.abs(p.x - from.x));
      box.setAttribute("height", Math.abs(p.y - from.y));
    }
    const near = inside(p) ? nearest(p) : null, q = near || p;
    mark.setAttribute("visibility", near ? "visible" : "hidden");
    mark.setAttribute("cx", q.x);
    mark.setAttribute("cy", q.y);
    output.textContent = !inside(p) ? "" :
      `${value(x, (q.x - left) / (right - left))},  ${value(y, (bottom - q.y) / (bottom - top))}`;
  });
  svg.addEventListener("pointerleave", () => {
    mark.setAttribute("visibility", "hidden");
    output.textContent = "";
  });
  svg.addEventListener("pointerdown", (event) => {
    // Fingers scroll and pinch.
    if (event.pointerType === "mouse" && event.button === 0) {
      from = place(event);
      svg.setPointerCapture(event.pointerId);
      event.preventDefault();
    }
  });
  svg.addEventListener("pointerup", (event) => {
    if (!from) return;
    const a = from, b = place(event);
    from = null;
    box.setAttribute("visibility", "hidden");
    if (Math.abs(a.x - b.x) < 100 || Math.abs(a.y - b.y) < 100) return;
    // Of the whole drawing, so that figures of several axes stay together.
    const view = svg.getCTM(), outer = whole.getCTM().inverse();
    const [p, q] = [a, b].map((of) => new DOMPoint(of.x, of.y).matrixTransform(view).matrixTransform(outer));
    whole.dataset.all ??= whole.getAttribute("viewBox");
    whole.setAttribute("viewBox",
      `${Math.min(p.x, q.x)} ${Math.min(p.y, q.y)} ${Math.abs(p.x - q.x)} ${Math.abs(p.y - q.y)}`);
  });
  svg.addEventListener("dblclick", () => {
    if (whole.dataset.all) whole.setAttribute("viewBox", whole.dataset.all);
  });
}
if (document.querySelector("figure output")) {
  const hint = document.createElement("p");
  hint.className = "hint";
  hint.textContent = "Point at a curve to read it, drag to enlarge a part, double-click to go back.";
  document.querySelector("figure").before(hint);
}
