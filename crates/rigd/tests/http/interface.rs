//! The interface as a whole: its document, names of runs, pages, conditions, and the decision
//! about a refused touch.

use axum::http::Response;

use super::*;

impl Daemon {
    /// The answer to a request without a body.
    pub(super) async fn raw(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
    ) -> Response<Body> {
        let mut request =
            Request::builder().method(method).uri(path).header(header::HOST, "localhost");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()
    }

    async fn get(&self, path: &str) -> Value {
        let (status, value) = self.ask("GET", path, &Value::Null).await;
        assert_eq!(status, StatusCode::OK, "{path}: {value}");
        value
    }

    /// Begins a run of a protocol.
    pub(super) async fn begin(&self, protocol: &str) -> String {
        let (status, run) = self.ask("POST", "runs", &json!({ "protocol_toml": protocol })).await;
        assert_eq!(status, StatusCode::ACCEPTED, "{run}");
        run["id"].as_str().unwrap().to_owned()
    }

    pub(super) async fn run_to_its_end(&self, protocol: &str) -> String {
        let id = self.begin(protocol).await;
        let is_ended =
            |status: &Status| status.run.as_ref().is_some_and(|run| run.ending.is_some());
        self.handle.status().wait_for(is_ended).await.unwrap();
        self.wait_until_idle().await;
        id
    }
}

#[tokio::test]
async fn the_document_of_the_interface_is_the_committed_one_and_its_page_asks_no_other_host() {
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/openapi.json");
    let text = rigd::http::openapi::text();
    let known = std::fs::read_to_string(&committed).unwrap_or_default();
    assert!(text == known, "write `GET /openapi.json` to docs/openapi.json");
    let document: Value = serde_json::from_str(&text).unwrap();

    let daemon = Daemon::start().await;
    let served = daemon.raw("GET", "/openapi.json", &[]).await;
    assert_eq!(to_bytes(served.into_body(), usize::MAX).await.unwrap(), text.as_bytes());
    let page = daemon.raw("GET", "/reference", &[]).await;
    let page = to_bytes(page.into_body(), usize::MAX).await.unwrap();
    let page = String::from_utf8(page.to_vec()).unwrap();
    for call in ["src=", "href=\"http", "@import", "url(", "<script"] {
        assert!(!page.contains(call), "{call}");
    }
    // A saved page has no header, and keeps its policy.
    assert!(page.contains("Content-Security-Policy") && page.contains("default-src 'none'"));
    // Every reference of the document leads somewhere, and the page has every operation.
    let names = document["components"]["schemas"].as_object().unwrap();
    for reference in text.split("#/components/schemas/").skip(1) {
        let name = reference.split('"').next().unwrap();
        assert!(names.contains_key(name), "{name}");
    }
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let id = operation["operationId"].as_str().unwrap();
            assert!(page.contains(&format!("id=\"{id}\"")), "{method} {path}");
        }
    }
    daemon.close().await;
}

#[tokio::test]
async fn runs_have_names_links_pages_and_a_list_of_sweeps() {
    let daemon = Daemon::start().await;
    assert_eq!(daemon.ask("GET", "runs/latest", &Value::Null).await.0, StatusCode::NOT_FOUND);
    let mut ids = Vec::new();
    for _ in 0..3 {
        ids.push(daemon.run_to_its_end(SMOKE).await);
    }
    for (name, id) in [("latest", &ids[2]), ("smoke-1", &ids[0]), (&ids[1], &ids[1])] {
        assert_eq!(daemon.get(&format!("runs/{name}")).await["id"], **id);
    }
    // A session is no run, and part of an id is no name.
    let session = daemon.rig().await["session"].as_str().unwrap().to_owned();
    for other in ["smoke", "0", &ids[0][..8], &session] {
        let path = format!("runs/{other}/redo");
        let touch = json!({ "step": "main/1/front/0/1", "why": "no such run" });
        for (method, path) in [("GET", format!("runs/{other}")), ("POST", path)] {
            let (status, problem) = daemon.ask(method, &path, &touch).await;
            assert_eq!(status, StatusCode::NOT_FOUND, "{path}: {problem}");
        }
    }

    let links = daemon.get("runs/latest").await["links"].clone();
    for (what, href) in links.as_object().unwrap() {
        let answer = daemon.raw("GET", href.as_str().unwrap(), &[]).await;
        assert_eq!(answer.status(), StatusCode::OK, "{what}: {href}");
    }
    let sweeps = daemon.get("runs/latest/sweeps").await;
    let one = &sweeps.as_array().unwrap()[1];
    let whole = daemon.raw("GET", one["href"].as_str().unwrap(), &[]).await;
    let whole = to_bytes(whole.into_body(), usize::MAX).await.unwrap();
    let whole: Value = serde_json::from_slice(&whole).unwrap();
    assert_eq!(whole["readings"].as_array().unwrap().len(), one["readings"]);
    assert_eq!((&whole["outcome"], &whole["step"]), (&one["outcome"], &one["step"]));

    let (mut path, mut seen) = ("/api/v1/runs?limit=2".to_owned(), Vec::new());
    for page in 0..2 {
        let answer = daemon.raw("GET", &path, &[]).await;
        let next = answer.headers().get(header::LINK).cloned();
        let runs = to_bytes(answer.into_body(), usize::MAX).await.unwrap();
        let runs: Value = serde_json::from_slice(&runs).unwrap();
        seen.extend(
            runs.as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()),
        );
        assert_eq!(next.is_some(), page == 0, "{next:?}");
        if let Some(next) = next {
            let next = next.to_str().unwrap();
            path = next.split(['<', '>']).nth(1).unwrap().to_owned();
        }
    }
    ids.reverse();
    assert_eq!(seen, ids);
    for bad in ["limit=0", "limit=x", "page=2", "before=nothing"] {
        let status = daemon.raw("GET", &format!("/api/v1/runs?{bad}"), &[]).await.status();
        assert!(status.is_client_error(), "{bad}: {status}");
    }
    daemon.close().await;
}

#[tokio::test]
async fn a_command_for_a_state_that_has_passed_is_refused_but_never_a_stop() {
    let daemon = Daemon::start().await;
    let tag = async || {
        let answer = daemon.raw("GET", "/api/v1/rig", &[]).await;
        answer.headers()[header::ETAG].to_str().unwrap().to_owned()
    };
    let idle = tag().await;
    assert_eq!(idle, tag().await, "nothing has changed");
    let to = json!({ "axis": "linear", "to": 20.0 });
    let (status, _) = daemon.send("POST", "moves", &to, &[("if-match", &idle)]).await;
    assert_eq!(status, StatusCode::ACCEPTED);
    daemon.wait_until_idle().await;
    assert_ne!(idle, tag().await, "the probe is in contact");
    let (status, problem) = daemon.send("POST", "moves", &to, &[("if-match", &idle)]).await;
    assert_eq!(status, StatusCode::PRECONDITION_FAILED, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("in contact"), "{problem}");
    let (status, _) = daemon.send("POST", "moves", &to, &[("if-match", "*")]).await;
    assert_eq!(status, StatusCode::ACCEPTED);
    let stopped = daemon.raw("POST", "/api/v1/stop", &[("if-match", &idle)]).await;
    assert_eq!(stopped.status(), StatusCode::OK);
    daemon.close().await;
}

#[tokio::test]
async fn a_refused_touch_is_decided_over_http() {
    // The window of the sweep in contact ends below the resonance of the stiffer sample.
    let narrow = SMOKE.replace("max_hz = 260", "max_hz = 205");
    let ask = narrow.replace("[touch]\n", "[touch]\non_refusal = \"ask\"\n");
    assert!(narrow != SMOKE && ask != narrow);
    let daemon = Daemon::start_with(SimulatedPerson::Waits).await;
    let id = daemon.begin(&ask).await;
    let answer = async |options: String| {
        let path = format!("/api/v1/runs/{id}/answer?step={}", options.replace('/', "%2F"));
        daemon.raw("POST", &path, &[]).await.status()
    };
    // The same window refuses the first touch again; a wider one measures it.
    let mut words = ["repeat", "widen", "skip", "abort"].into_iter().peekable();
    let (mut status, mut decided) = (daemon.handle.status(), Vec::new());
    while status.borrow_and_update().run.as_ref().is_none_or(|run| run.ending.is_none()) {
        let rig = daemon.rig().await;
        if let Some(step) = rig["asked"]["step"].as_str() {
            // What is answered already is refused, and does no harm.
            answer(step.to_owned()).await;
        } else if let Some(step) = rig["refused"]["step"].as_str() {
            assert_eq!(rig["refused"]["answers"], json!(["widen", "repeat", "skip", "abort"]));
            assert_eq!(answer(format!("{step}&refused=perhaps")).await, StatusCode::BAD_REQUEST);
            let other = answer("main/1/front/0/9&refused=skip".to_owned()).await;
            assert_eq!(other, StatusCode::CONFLICT, "another touch");
            let word = *words.peek().unwrap();
            if answer(format!("{step}&refused={word}")).await == StatusCode::ACCEPTED {
                decided.push((step.to_owned(), word.to_owned(), "the lab".to_owned()));
                words.next();
            }
        }
        status.changed().await.unwrap();
    }
    daemon.wait_until_idle().await;
    let [first, second, third] = [&decided[1].0, &decided[2].0, &decided[3].0];
    assert!(decided[0].0 == *first && first != second && second != third, "{decided:?}");

    let run = daemon.get(&format!("runs/{id}")).await;
    assert_eq!(run["status"], "aborted");
    let touches = run["results"]["touch_results"].as_array().unwrap();
    let status = |step: &str| {
        let touch = touches.iter().find(|touch| touch["step"] == step).unwrap();
        touch["status"].as_str().unwrap().to_owned()
    };
    assert_eq!((status(first), status(second)), ("measured".to_owned(), "refused".to_owned()));
    let mut records =
        Reader::open(daemon.data.path()).unwrap().records(id.parse().unwrap()).unwrap();
    records.retain(|record| record.kind == "refusal_answered");
    let given: Vec<_> = records
        .iter()
        .map(|record| match record.record().unwrap() {
            Record::RefusalAnswered(given) => (given.step, given.answer, given.by),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(given, decided);
    daemon.close().await;
}
