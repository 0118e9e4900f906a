// Draws every plot of the page from its data, anew when the colour scheme or the medium changes.
(() => {
  "use strict";
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const root = document.documentElement;
  let charts = [];

  const named = (axis) => axis.unit ? `${axis.label} [${axis.unit}]` : axis.label;
  const shown = (value, unit) =>
    value == null ? "–" : `${Number(value.toPrecision(4))}${unit ? " " + unit : ""}`;
  const scaled = (values, factor) => values.map((v) => (v == null ? null : v * factor));

  // One row of abscissae for all series: uPlot joins them, with gaps only where data has them.
  const joined = (plot) => {
    const tables = plot.series.map((s) => [scaled(s.x, plot.x.factor), scaled(s.y, plot.y.factor)]);
    if (tables.every((t) => t[0].length === tables[0][0].length
        && t[0].every((v, i) => v === tables[0][0][i]))) {
      return [tables[0][0], ...tables.map((t) => t[1])];
    }
    return uPlot.join(tables);
  };

  const markers = (plot, color) => (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = color("--soft");
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    for (const marker of plot.markers) {
      const value = marker.value * (marker.vertical ? plot.x.factor : plot.y.factor);
      const at = u.valToPos(value, marker.vertical ? "x" : "y", true);
      const [from, to] = marker.vertical
        ? [bbox.left, bbox.left + bbox.width] : [bbox.top, bbox.top + bbox.height];
      if (!(at >= from && at <= to)) continue;
      ctx.beginPath();
      if (marker.vertical) {
        ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height);
        const width = ctx.measureText(marker.label).width + 12 * devicePixelRatio;
        const left = at + width > bbox.left + bbox.width;
        ctx.textAlign = left ? "right" : "left";
        ctx.fillText(marker.label, at + (left ? -5 : 5) * devicePixelRatio, bbox.top + 14 * devicePixelRatio);
      } else {
        ctx.moveTo(bbox.left, at); ctx.lineTo(bbox.left + bbox.width, at);
        ctx.textAlign = "right";
        ctx.fillText(marker.label, bbox.left + bbox.width - 5 * devicePixelRatio, at - 5 * devicePixelRatio);
      }
      ctx.stroke();
    }
    ctx.restore();
  };

  const options = (plot, width) => {
    const style = getComputedStyle(root);
    const color = (name) => style.getPropertyValue(name).trim();
    const axis = (of, extra) => ({
      label: named(of), stroke: color("--ink"), labelFont: "12px system-ui, sans-serif",
      font: "12px system-ui, sans-serif", labelSize: 22,
      grid: { stroke: color("--rule"), width: 1 }, ticks: { stroke: color("--rule"), width: 1 }, ...extra,
    });
    const log = (of) => (of.log ? { distr: 3 } : {});
    const inside = (u, min, max) => {
      const pad = (max - min || Math.abs(max) || 1) * 0.05;
      return [min - pad, max + pad];
    };
    return {
      width, height: Math.round(Math.min(340, Math.max(260, width * 0.55))),
      scales: {
        x: { time: false, ...log(plot.x) },
        y: plot.y.log ? log(plot.y) : { range: inside },
      },
      axes: [axis(plot.x, { size: 38 }), axis(plot.y, {
        size: (u, values) => 16 + 7 * Math.max(2, ...(values || []).map((v) => (v || "").length)),
      })],
      series: [{ label: plot.x.label, value: (u, v) => shown(v, plot.x.unit) },
        ...plot.series.map((s, i) => ({
          label: s.name, stroke: color(`--c${i % 6}`), width: 1.8, dash: s.dashed ? [7, 5] : undefined,
          spanGaps: false, points: { show: false }, value: (u, v) => shown(v, plot.y.unit),
        }))],
      cursor: {
        drag: { x: true, y: false, setScale: true }, focus: { prox: 24 },
        sync: plot.sync ? { key: plot.sync, setSeries: false } : undefined,
      },
      legend: { markers: { fill: (u, i) => (i ? color(`--c${(i - 1) % 6}`) : "transparent") } },
      hooks: { draw: [markers(plot, color)] },
    };
  };

  const draw = () => {
    for (const chart of charts) chart.destroy();
    charts = [...document.querySelectorAll("[data-plot]")].map((place) => {
      const plot = plots[Number(place.dataset.plot)];
      return new uPlot(options(plot, place.clientWidth), joined(plot), place);
    });
  };

  const fit = () => {
    for (const chart of charts) {
      const width = chart.root.parentElement.clientWidth;
      const height = Math.round(Math.min(340, Math.max(260, width * 0.55)));
      if (width !== chart.width) chart.setSize({ width, height });
    }
  };

  draw();
  addEventListener("resize", fit);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  const printing = (on) => { root.classList.toggle("print", on); draw(); };
  addEventListener("beforeprint", () => printing(true));
  addEventListener("afterprint", () => printing(false));
  window.charts = () => charts;
})();
