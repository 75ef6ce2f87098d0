// Sliders between two pictures, values of curves under the pointer, and frames that take part once they are clicked.
for (const figure of document.querySelectorAll("figure.embed")) {
  const [frame, button] = ["iframe", "button"].map((name) => figure.querySelector(name));
  button.addEventListener("click", () => {
    button.remove();
    frame.inert = false;
    frame.focus();
  });
}
for (const figure of document.querySelectorAll("figure.compare")) {
  const slider = figure.querySelector("input");
  slider.addEventListener("input", () => figure.style.setProperty("--at", `${slider.value}%`));
}
for (const figure of document.querySelectorAll("figure.curve")) {
  const [svg, line, caption] = ["svg", "polyline", "figcaption"].map((name) => figure.querySelector(name));
  const rows = JSON.parse(figure.dataset.points);
  const corners = line.getAttribute("points").trim().split(" ").map((pair) => pair.split(",").map(Number));
  const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
  const text = caption.textContent;
  dot.setAttribute("r", "3");
  svg.addEventListener("pointermove", (event) => {
    const x = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()).x;
    const nearest = corners.reduce((best, corner, i) => (Math.abs(corner[0] - x) < Math.abs(corners[best][0] - x) ? i : best), 0);
    dot.setAttribute("cx", corners[nearest][0]);
    dot.setAttribute("cy", corners[nearest][1]);
    svg.append(dot);
    caption.textContent = `${text.split(" (")[0]}: ${rows[nearest][1].toPrecision(5)} at step ${rows[nearest][0]}`;
  });
  svg.addEventListener("pointerleave", () => {
    dot.remove();
    caption.textContent = text;
  });
}
