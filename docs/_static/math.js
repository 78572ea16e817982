// Draws what Sphinx leaves as \( TeX \) or \[ TeX \] in elements of class math.
document.addEventListener("DOMContentLoaded", () => {
  for (const element of document.querySelectorAll(".math")) {
    const number = element.querySelector(".eqno");
    if (number) number.remove();
    const tex = element.textContent.trim().replace(/^\\[([]/, "").replace(/\\[)\]]$/, "");
    katex.render(tex, element, { displayMode: element.tagName === "DIV", throwOnError: false });
  }
});
