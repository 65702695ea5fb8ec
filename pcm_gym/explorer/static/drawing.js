// Drawing in SVG: places in the plane to places in a picture, lines, marks and axes.

const SVG = "http://www.w3.org/2000/svg";

export const COLOURS = { stable: "#0b6bb8", unstable: "#b4520f", chosen: "#101820", limit: "#c2242e", other: "#8c97a4",
  crossing: "#6a3fb5", metal: "#8c97a4", grid: "#e4e8ed", text: "#667485" };

export function add(parent, kind, attributes, text) {
  const element = document.createElementNS(SVG, kind);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

// A view of a rectangle of the plane; `equal` keeps one scale for both axes.
export class View {
  constructor(svg, bounds, { equal = false, width = 600, height = 600, margin = [16, 16, 16, 16] } = {}) {
    Object.assign(this, { svg, width, height, margin });
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const [top, right, bottom, left] = margin;
    let [x0, x1, y0, y1] = bounds;
    let sx = (width - left - right) / (x1 - x0 || 1), sy = (height - top - bottom) / (y1 - y0 || 1);
    if (equal) sx = sy = Math.min(sx, sy);
    Object.assign(this, { sx, sy, xm: (x0 + x1) / 2, ym: (y0 + y1) / 2, bounds,
      cx: left + (width - left - right) / 2, cy: top + (height - top - bottom) / 2 });
  }
  x(value) { return this.cx + (value - this.xm) * this.sx; }
  y(value) { return this.cy - (value - this.ym) * this.sy; }
  place(event) { // of a pointer, in the plane
    const box = this.svg.getBoundingClientRect(), scale = this.width / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
  }
  world(event) {
    const [x, y] = this.place(event);
    return [this.xm + (x - this.cx) / this.sx, this.ym - (y - this.cy) / this.sy];
  }
  points(list) { return list.map(([x, y]) => `${this.x(x).toFixed(1)},${this.y(y).toFixed(1)}`).join(" "); }
  line(parent, list, colour, width, more = {}) {
    return add(parent, "polyline", { points: this.points(list), fill: "none", stroke: colour, "stroke-width": width,
      "stroke-linejoin": "round", ...more });
  }
  dot(parent, [x, y], radius, fill, stroke = "#fff", more = {}) {
    return add(parent, "circle", { cx: this.x(x), cy: this.y(y), r: radius, fill, stroke, "stroke-width": 2, ...more });
  }
  axes(names) {
    const { svg, bounds: [x0, x1, y0, y1], height, margin: [top, , bottom, left] } = this;
    const size = 15;
    for (const x of ticks(x0, x1)) {
      this.line(svg, [[x, y0], [x, y1]], COLOURS.grid, 1);
      add(svg, "text", { x: this.x(x), y: height - bottom + 18, "text-anchor": "middle", "font-size": size, fill: COLOURS.text }, label(x));
    }
    for (const y of ticks(y0, y1)) {
      this.line(svg, [[x0, y], [x1, y]], COLOURS.grid, 1);
      add(svg, "text", { x: left - 6, y: this.y(y) + 5, "text-anchor": "end", "font-size": size, fill: COLOURS.text }, label(y));
    }
    add(svg, "text", { x: this.x((x0 + x1) / 2), y: height - 6, "text-anchor": "middle", "font-size": size, fill: COLOURS.text }, names[0]);
    add(svg, "text", { x: 4, y: Math.max(top - 8, 14), "font-size": size, fill: COLOURS.text }, names[1]);
  }
}

function ticks(low, high) {
  const wanted = (high - low) / 5, power = 10 ** Math.floor(Math.log10(wanted));
  const step = [1, 2, 5, 10].map(factor => factor * power).find(own => own >= wanted);
  const found = [];
  for (let n = Math.ceil(low / step); n * step <= high + 1e-9 * step; n++) found.push(n * step);
  return found;
}

export function label(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  return size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : String(Number(value.toPrecision(4)));
}

export function rangeOf(values, part = 0.05) {
  let low = Infinity, high = -Infinity;
  for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
  const rim = part * (high - low) || 1;
  return [low - rim, high + rim];
}
