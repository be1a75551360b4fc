// The explanation of a term: shown on hover, when the term has the focus, and by tap; Escape hides it.
const tip = document.createElement("div");
let explained = null;
tip.id = "tip"; tip.setAttribute("role", "tooltip"); tip.hidden = true;
document.body.append(tip);

function showTip(term) {
  if (explained === term) return;
  hideTip();
  explained = term;
  tip.textContent = term.dataset.tip;
  tip.hidden = false;
  term.setAttribute("aria-describedby", "tip");
  const box = term.getBoundingClientRect(), wide = root.clientWidth, gap = 6;
  const above = box.bottom + gap + tip.offsetHeight > innerHeight && box.top > tip.offsetHeight + gap;
  tip.style.left = `${scrollX + Math.max(gap, Math.min(box.left, wide - tip.offsetWidth - gap))}px`;
  tip.style.top = `${scrollY + (above ? box.top - tip.offsetHeight - gap : box.bottom + gap)}px`;
}

function hideTip() {
  if (explained) explained.removeAttribute("aria-describedby");
  explained = null;
  tip.hidden = true;
}

// A term as an element; its text and explanation are inserted as text.
function term(text, explanation) {
  const made = document.createElement("span");
  made.textContent = text;
  if (!explanation) return made;
  made.className = "term"; made.tabIndex = 0; made.dataset.tip = explanation;
  return made;
}

const termAt = (event) => (event.target instanceof Element ? event.target.closest(".term") : null);
for (const name of ["pointerover", "focusin", "click"]) {
  addEventListener(name, (event) => { const at = termAt(event); if (at) showTip(at); else if (event.target !== tip) hideTip(); });
}
addEventListener("focusout", hideTip);
addEventListener("keydown", (event) => { if (event.key === "Escape") hideTip(); });
