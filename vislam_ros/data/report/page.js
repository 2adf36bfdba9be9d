"use strict";
// The charts, and what ties the scene to the series: a moment pointed at in one shows in the other.
(function () {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const scene = document.getElementById("map");
  const narrow = window.matchMedia("(max-width: 600px)").matches;
  const config = { responsive: true, displaylogo: false, displayModeBar: narrow ? false : "hover" };
  const charts = figures.series.map(function (figure) {
    const place = document.createElement("div");
    place.style.height = figure.layout.height + "px";
    document.getElementById("series").append(place);
    return { place, figure, shown: null };
  });
  // What all charts show: a new object for each change. `range` null is all of the time.
  let view = { range: null, marks: [] };
  let isDrawing = false;

  function fail(element, error) {
    element.textContent = "This chart cannot be drawn here: " + error;
  }

  function drawn(name) {
    const marks = document.documentElement.dataset;
    if (!(name in marks)) { marks[name] = Math.round(performance.now()); }
  }

  // What was asked of the page meanwhile comes first.
  function soon(action) {
    return new Promise((resolve) => window.setTimeout(resolve, 0)).then(action);
  }

  // Pixels from what is on the screen; 0 for what is there itself.
  function distance(chart) {
    const box = chart.place.getBoundingClientRect();
    return Math.max(box.top - window.innerHeight, -box.bottom, 0);
  }

  function isOnScreen(chart) {
    return distance(chart) === 0;
  }

  function nearest(times, time) {
    let low = 0;
    let high = times.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < time) { low = middle + 1; } else { high = middle; }
    }
    return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
  }

  function draw(chart) {
    const isNew = chart.shown === null;
    const layout = chart.figure.layout;
    chart.shown = view;
    layout.shapes = view.marks;
    layout.xaxis.autorange = view.range === null;
    if (view.range !== null) { layout.xaxis.range = view.range.slice(); }
    if (narrow) { layout.margin.l = 44; }
    return Plotly.react(chart.place, chart.figure.data, layout, config)
      .then(() => { if (isNew) { tie(chart); } })
      .catch((error) => fail(chart.place, error));
  }

  // One chart after the other, the nearest to the screen first, until all show the view.
  function drawAll() {
    const late = charts.filter((chart) => chart.shown !== view);
    if (!late.some(isOnScreen)) { drawn("shownMs"); }
    isDrawing = late.length > 0;
    if (!isDrawing) {
      drawn("drawnMs");
      return;
    }
    const next = late.reduce((one, other) => distance(other) < distance(one) ? other : one);
    soon(() => draw(next)).then(drawAll);
  }

  function look(changes) {
    view = Object.assign({}, view, changes);
    if (!isDrawing) { drawAll(); }
  }

  let pointedAt = null;
  function point(time) {
    if (pointedAt === null) { window.requestAnimationFrame(showPoint); }
    pointedAt = time;
  }

  function showPoint() {
    const time = pointedAt;
    pointedAt = null;
    if (!scene._fullData) { return; }
    const path = scene._fullData[0];
    const k = nearest(path.customdata, time);
    document.getElementById("now").textContent = path.customdata[k].toFixed(2) + " s: " +
      [path.x[k], path.y[k], path.z[k]].map((value) => value.toFixed(2)).join(", ") + " m";
    Plotly.restyle(
      scene, { x: [[path.x[k]]], y: [[path.y[k]]], z: [[path.z[k]]], visible: true },
      [scene._fullData.length - 1]);
  }

  function tie(chart) {
    function others() {
      return charts.filter((each) => each !== chart && each.shown !== null && isOnScreen(each));
    }
    chart.place.on("plotly_hover", function (event) {
      const time = event.xvals ? event.xvals[0] : event.points[0].x;
      // The last argument keeps them from telling it on.
      others().forEach((each) => Plotly.Fx.hover(each.place, { xval: time }, "xy", true));
      point(time);
    });
    chart.place.on("plotly_unhover", function (event) {
      if (event && event.event) { others().forEach((each) => Plotly.Fx.unhover(each.place)); }
    });
    chart.place.on("plotly_relayout", function (event) {
      if (event["xaxis.range[0]"] !== undefined) {
        look({ range: [event["xaxis.range[0]"], event["xaxis.range[1]"]] });
      } else if (event["xaxis.autorange"]) {
        look({ range: null });
      }
    });
  }

  function tieScene() {
    scene.on("plotly_click", function (event) {
      const { curveNumber, customdata } = event.points[0];
      if (curveNumber !== 0) { return; }
      look({ marks: [{
        type: "line", x0: customdata, x1: customdata, y0: 0, y1: 1, xref: "x", yref: "paper",
        line: { width: 1, dash: "dot" } }] });
    });
  }

  if (narrow) {
    figures.scene.data.forEach((trace) => {
      if (trace.marker && trace.marker.colorbar) { trace.marker.colorbar.len = 0.4; }
    });
  }
  // The text is painted first, then the map can be used, then the charts follow.
  soon(() => Plotly.newPlot(scene, figures.scene.data, figures.scene.layout, config))
    .then(tieScene)
    .catch((error) => fail(scene, error))
    .then(() => drawn("mapMs"))
    .then(drawAll);
})();
