//! A browser that is driven as WebDriver says: the few calls that these tests make.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// One browser at a time: each draws on all cores.
static ONE: Mutex<()> = Mutex::new(());

pub struct Browser {
    driver: Child,
    session: String,
    _profile: TempDir,
    _one: MutexGuard<'static, ()>,
}

/// Seconds that anything may take.
const LONG: u64 = 240;

impl Browser {
    /// Starts a browser, or says that there is none.
    pub fn start(test: &str) -> Option<Self> {
        Self::with(test, &["--enable-unsafe-swiftshader"])
    }

    pub fn with(test: &str, flags: &[&str]) -> Option<Self> {
        let one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let mut command = Command::new("chromedriver");
        let Ok(mut driver) = command.arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn() else {
            eprintln!("skipped: no browser ({test})");
            return None;
        };
        let lines = BufReader::new(driver.stdout.take().unwrap()).lines().map_while(Result::ok);
        let port = |line: String| line.split_once("successfully on port ")?.1.trim_end_matches('.').parse::<u16>().ok();
        let Some(port) = lines.filter_map(port).next() else {
            let _ = driver.kill();
            eprintln!("skipped: no browser ({test})");
            return None;
        };
        let profile = tempfile::tempdir().unwrap();
        let own = format!("--user-data-dir={}", profile.path().display());
        let usual = [
            "--headless=new",
            "--no-sandbox",
            "--disable-background-networking",
            "--disable-dev-shm-usage",
            "--window-size=1000,700",
        ];
        let all: Vec<&str> = usual.iter().chain(flags).copied().chain([own.as_str()]).collect();
        let wanted = json!({ "browserName": "chrome", "goog:chromeOptions": { "args": all }, "goog:loggingPrefs": { "browser": "ALL" } });
        let begin = json!({ "capabilities": { "alwaysMatch": wanted } });
        let root = format!("http://127.0.0.1:{port}/session");
        let session = match call(minreq::post(&root), &begin)
            .and_then(|made| Ok(made["sessionId"].as_str().ok_or("no session")?.to_string()))
        {
            Ok(id) => format!("{root}/{id}"),
            Err(error) => {
                let _ = driver.kill();
                eprintln!("skipped: no browser ({test}): {error}");
                return None;
            }
        };
        Some(Self { driver, session, _profile: profile, _one: one })
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        call(minreq::post(format!("{}/{path}", self.session)), body).unwrap_or_else(|error| panic!("{path}: {error}"))
    }

    pub fn open(&self, address: &str) {
        self.post("url", &json!({ "url": address }));
    }

    /// Opens a page and waits until it has drawn, or said why it does not.
    pub fn open_page(&self, address: &str) {
        self.open(address);
        self.wait("document.body.classList.contains('failed') || globalThis.splatweaver?.canvas.classList.contains('shown') && !splatweaver.sorting && !splatweaver.pending");
    }

    /// Goes into the first frame of the page, or back out of all.
    pub fn frame(&self, within: bool) {
        self.post("frame", &json!({ "id": within.then_some(0) }));
    }

    /// The value of a JavaScript expression.
    pub fn value(&self, expression: &str) -> Value {
        self.post("execute/sync", &json!({ "script": format!("return ({expression})"), "args": [] }))
    }

    pub fn text(&self, expression: &str) -> String {
        self.value(expression).as_str().unwrap_or_else(|| panic!("{expression} is a text")).to_string()
    }

    pub fn number(&self, expression: &str) -> f64 {
        self.value(expression).as_f64().unwrap_or_else(|| panic!("{expression} is a number"))
    }

    pub fn is(&self, expression: &str) -> bool {
        self.value(&format!("Boolean({expression})")).as_bool().unwrap()
    }

    /// The value of a promise.
    pub fn awaited(&self, expression: &str) -> Value {
        let script = format!(
            "const done = arguments[0]; Promise.resolve({expression}).then(done, (error) => done('failed: ' + error.message))"
        );
        self.post("timeouts", &json!({ "script": LONG * 1000 }));
        self.post("execute/async", &json!({ "script": script, "args": [] }))
    }

    #[track_caller]
    pub fn wait(&self, expression: &str) {
        let start = Instant::now();
        while !self.is(expression) {
            assert!(start.elapsed() < Duration::from_secs(LONG), "waited in vain for {expression}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// A command of the browser's own protocol.
    pub fn browser(&self, command: &str, parameters: Value) {
        self.post("goog/cdp/execute", &json!({ "cmd": command, "params": parameters }));
    }

    /// Sets the size of the page, as of a phone or a desktop.
    pub fn resize(&self, width: u32, height: u32, mobile: bool) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile });
        self.browser("Emulation.setDeviceMetricsOverride", size);
    }

    /// Presses keys, one after the other.
    pub fn press(&self, keys: &[&str]) {
        let actions: Vec<Value> = keys
            .iter()
            .flat_map(|key| ["keyDown", "keyUp"].map(|kind| json!({ "type": kind, "value": key })))
            .collect();
        self.post("actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
    }

    /// Presses a key while Control is held.
    pub fn control(&self, key: &str) {
        let act = |kind: &str, key: &str| json!({ "type": kind, "value": key });
        let actions = [act("keyDown", "\u{e009}"), act("keyDown", key), act("keyUp", key), act("keyUp", "\u{e009}")];
        self.post("actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
    }

    /// Writes a text into a field in place of its own, and leaves it by Enter.
    pub fn fill(&self, field: &str, text: &str) {
        self.value(&format!("(({field}).focus(), ({field}).select())"));
        let letters: Vec<String> = text.chars().map(String::from).collect();
        let keys: Vec<&str> = letters.iter().map(String::as_str).chain(["\u{e007}"]).collect();
        self.press(&keys);
    }

    /// Clicks the middle of an element, which is brought into view.
    pub fn click_on(&self, element: &str) {
        let middle = format!(
            "(() => {{ const e = {element}; e.scrollIntoView({{ block: 'center' }}); const b = e.getBoundingClientRect(); \
             return [Math.round(b.left + b.width / 2), Math.round(b.top + b.height / 2)]; }})()"
        );
        let place = self.value(&middle);
        let at = |i: usize| place[i].as_i64().unwrap_or_else(|| panic!("{element} has a place")) as i32;
        self.click([at(0), at(1)], 1);
    }

    /// The file of this name that the page offers when `act` is done.
    pub fn downloaded(&self, name: &str, act: impl FnOnce()) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let place = json!({ "behavior": "allow", "downloadPath": folder.path() });
        self.browser("Browser.setDownloadBehavior", place);
        act();
        let (start, path) = (Instant::now(), folder.path().join(name));
        while !path.exists() {
            assert!(start.elapsed() < Duration::from_secs(60), "no file {name} came");
            std::thread::sleep(Duration::from_millis(50));
        }
        std::fs::read(path).unwrap()
    }

    /// Drags from one place to another.
    pub fn drag(&self, from: [i32; 2], to: [i32; 2]) {
        let go =
            |[x, y]: [i32; 2], duration: u32| json!({ "type": "pointerMove", "duration": duration, "x": x, "y": y });
        let press = |kind: &str| json!({ "type": kind, "button": 0 });
        let actions = [go(from, 0), press("pointerDown"), go(to, 120), press("pointerUp")];
        self.post("actions", &json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] }));
    }

    /// Clicks a place so many times.
    pub fn click(&self, [x, y]: [i32; 2], times: usize) {
        let press = |kind: &str| json!({ "type": kind, "button": 0 });
        let mut actions = vec![json!({ "type": "pointerMove", "duration": 0, "x": x, "y": y })];
        (0..times).for_each(|_| actions.extend([press("pointerDown"), press("pointerUp")]));
        self.post("actions", &json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] }));
    }

    /// Errors that the page wrote to the console.
    pub fn errors(&self) -> Vec<String> {
        let log = self.post("se/log", &json!({ "type": "browser" }));
        let lines = log.as_array().into_iter().flatten().filter(|line| line["level"] == "SEVERE");
        lines.map(|line| line["message"].to_string()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = minreq::delete(&self.session).with_timeout(10).send();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

fn call(request: minreq::Request, body: &Value) -> Result<Value, String> {
    let request = request.with_header("Content-Type", "application/json").with_timeout(LONG + 20);
    let answer = request.with_body(body.to_string()).send().map_err(|error| error.to_string())?;
    let mut answer_value: Value = serde_json::from_slice(answer.as_bytes()).map_err(|error| error.to_string())?;
    let value = answer_value["value"].take();
    if answer.status_code == 200 {
        Ok(value)
    } else {
        Err(value["message"].as_str().unwrap_or("refused").lines().next().unwrap_or_default().into())
    }
}
