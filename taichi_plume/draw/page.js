// The only script of the page: slow drags, keys, links, what the browser shows, a lost server, and the editor.
// acts, seen, text, editor, notes: models of Bokeh, of which a change reaches the server.

// Bokeh takes no drag that begins 0.3 s after the press; the longest timer of browsers puts that off
Bokeh.require("core/ui_gestures").UIGestures.press_threshold = 2 ** 31 - 1

const act = (words) => { acts.value = `${words} ${Date.now()}` }

// where the pointer was last: name of the view and position [m]
let at = ""
for (const plot of [above, ...sides]) {
  for (const kind of ["mousemove", "mouseenter"]) plot.on_event(kind, ({x, y}) => { at = `${plot.name} ${x} ${y}` })
  Bokeh.index.find_one(plot).canvas.events_el.style.touchAction = "none"  // a finger moves the view, not the page
}
const within = (event, model) => event.composedPath().includes(Bokeh.index.find_one(model)?.el)
document.addEventListener("contextmenu", (event) => {
  if (![above, ...sides].some((plot) => within(event, plot))) return
  event.preventDefault()
  act(`menu:${at} ${event.clientX} ${event.clientY}`)
}, true)
document.addEventListener("pointerdown", (event) => { if (!within(event, menu)) menu.visible = false }, true)

let edited = null  // field with an entry that has not been taken yet: there the browser undoes the typing
document.addEventListener("input", (event) => {
  const [target] = event.composedPath()
  edited = target.type == "text" ? target : null
})
document.addEventListener("focusin", () => { edited = null })

const ARROWS = {arrowleft: "-1 0", arrowright: "1 0", arrowup: "0 1", arrowdown: "0 -1"}
let moved = 0
document.addEventListener("keydown", (event) => {
  const target = event.composedPath()[0]
  if (event.key == "Enter") edited = null
  const typing = ["INPUT", "TEXTAREA", "SELECT"].includes(target.tagName) || target.role == "slider"
  const command = event.ctrlKey || event.metaKey
  const key = event.key.toLowerCase()
  const name = command ? {z: event.shiftKey ? "redo" : "undo", y: "redo", d: "copy", s: "save", c: "clip", v: `paste:${at}`, a: "all"}[key]
    : key in ARROWS ? `move:${ARROWS[key]} ${event.shiftKey ? 10 : 1}`
    : {delete: "delete", backspace: "delete", escape: "escape", "?": "help"}[key]
  if (name == null || event.altKey) return
  if (typing && name != "save" && (target == edited || !["undo", "redo"].includes(name))) return
  if (name != "clip") event.preventDefault()  // selected words are copied, too
  if (event.repeat && event.timeStamp - moved < 100) return
  moved = event.timeStamp
  if (typing) target.dispatchEvent(new Event("change"))  // Bokeh takes an entry once its field is left
  act(name)
})

// texts that the server writes hold links such as <a data-act="choose:obstacles[0]">
document.addEventListener("click", (event) => {
  const link = event.composedPath().find((node) => node.dataset?.act)
  if (link == null) return
  event.preventDefault()
  act(link.dataset.act)
})

const dark = matchMedia("(prefers-color-scheme: dark)")
const tell = () => { seen.value = `${document.visibilityState} ${dark.matches ? "dark" : "light"}` }
document.addEventListener("visibilitychange", tell)
dark.addEventListener("change", tell)
tell()

// ------------------------------------------------------------------ a lost server

const KEPT = "taichi_plume_text"
const [own] = Bokeh.documents
const banner = document.createElement("div")
banner.className = "lost"
banner.setAttribute("role", "alert")

const back = async () => {
  const answer = await fetch("share/room.yaml").catch(() => null)
  if (answer == null) return setTimeout(back, 2000)
  if (answer.ok) {  // the same server: its page has ended meanwhile, and begins anew
    if (text.value_input != banner.text) sessionStorage.setItem(KEPT, text.value_input)
    location.reload()
  } else banner.textContent = "Another server runs at this address now. Open the address that it has printed; "
    + "unsaved changes wait there as a draft. What is typed here goes nowhere: copy it from the tab YAML."
}
own.on_event("connection_lost", () => {
  banner.text = text.value_input
  banner.textContent = "The server of this page does not answer: nothing is saved or run now. The text stays in the tab "
    + "YAML. The page goes on by itself once the server answers; if the command has ended, start it again: it offers "
    + "unsaved changes."
  document.body.append(banner)
  setTimeout(back, 2000)
})
const kept = sessionStorage.getItem(KEPT)
sessionStorage.removeItem(KEPT)
if (kept != null) text.value_input = kept

// ------------------------------------------------------------------ the editor: Ace over the text's plain area

const load = (name) => new Promise((loaded, failed) => {
  const script = Object.assign(document.createElement("script"), {src: `editor/${name}.js`, onload: loaded, onerror: failed})
  document.head.append(script)
})

const begin = () => {
  const place = Bokeh.index.find_one(editor).shadow_el.appendChild(document.createElement("div"))
  const ace_editor = ace.edit(place, {
    mode: "ace/mode/yaml", tabSize: 2, useSoftTabs: true, showPrintMargin: false, useWorker: false, scrollPastEnd: 0.3,
    enableBasicAutocompletion: true, enableLiveAutocompletion: true, enableKeyboardAccessibility: true,
  })
  const {session, renderer} = ace_editor, {Range} = ace.require("ace/range")
  renderer.attachToShadowRoot()
  ace_editor.commands.removeCommands(["undo", "redo"])  // those of the room undo what is typed, too
  const paint = () => ace_editor.setTheme(`ace/theme/${dark.matches ? "github_dark" : "github_light_default"}`)
  dark.addEventListener("change", paint)
  paint()
  let writing = false
  const show = () => {  // change only what differs: the cursor stays
    const [old, wanted] = [ace_editor.getValue(), text.value_input]
    if (old == wanted) return
    const shorter = Math.min(old.length, wanted.length)
    let first = 0, last = 0
    while (first < shorter && old[first] == wanted[first]) first++
    while (last < shorter - first && old[old.length - 1 - last] == wanted[wanted.length - 1 - last]) last++
    const {doc} = session, at = (index) => doc.indexToPosition(index)
    writing = true
    session.replace(Range.fromPoints(at(first), at(old.length - last)), wanted.slice(first, wanted.length - last))
    writing = false
  }
  const note = () => {
    const {marks, row} = JSON.parse(notes.value)
    session.setAnnotations(marks)
    if (row != null && !ace_editor.isFocused()) ace_editor.gotoLine(row + 1, 0)
  }
  session.setUseWrapMode(false)
  let waits = false  // a selection that is typed over is removed and inserted: one step
  session.on("change", () => {
    if (writing || waits) return
    waits = true
    queueMicrotask(() => { [waits, text.value_input] = [false, ace_editor.getValue()] })
  })
  text.properties.value_input.change.connect(show)
  notes.properties.value.change.connect(note)
  ace_editor.completers = [{
    identifierRegexps: [/[\w.]/],
    getCompletions: async (_editor, _session, position, _prefix, found) => {
      const whole = ace_editor.getValue(), index = session.doc.positionToIndex(position)
      const question = {method: "POST", body: `${whole.slice(0, index)}\0${whole.slice(index)}`}
      const answer = await fetch("editor/completions", question).catch(() => null)
      found(null, answer?.ok ? await answer.json() : [])
    },
  }]
  new ResizeObserver(() => ace_editor.resize()).observe(place)
  show()
  note()
  Bokeh.index.find_one(text).el.style.display = "none"
}
load("ace").then(() => Promise.all([load("mode-yaml"), load("ext-language_tools")])).then(begin, () => null)
