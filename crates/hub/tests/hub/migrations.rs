//! The versions of the schema.

use rig_hub::{
    Catalogue, CatalogueError, MIGRATIONS, MigrationError, VersionError, admin, connect, doctor,
    migrate,
};

use crate::support::{Hub, server};

#[tokio::test]
async fn a_database_is_made_once_and_brought_up_to_date_any_number_of_times() {
    let hub = Hub::new().await;
    let config = server().admin(&hub.database);
    assert_eq!(admin::init(&config).await.unwrap(), 0);
    let state = rig_hub::state(&hub.admin).await.unwrap();
    assert_eq!(state.version, MIGRATIONS.len());
    let owners = "SELECT DISTINCT tableowner::text FROM pg_tables WHERE schemaname = 'hub'";
    let owners = hub.admin.query(owners, &[]).await.unwrap();
    assert_eq!(owners.iter().map(|row| row.get::<_, &str>(0)).collect::<Vec<_>>(), ["rigd_hub"]);
}

#[tokio::test]
async fn a_newer_and_an_altered_database_are_refused_and_stay_as_they_are() {
    let hub = Hub::new().await;
    let (mut client, _task) = connect(&server().admin(&hub.database), None).await.unwrap();
    let (known, next) = (MIGRATIONS.len(), MIGRATIONS.len() + 1);
    let newer = format!("INSERT INTO hub.migration VALUES ({next}, 'of the future', '')");
    client.batch_execute(&newer).await.unwrap();
    let refused = migrate(&mut client).await;
    let Err(MigrationError::Newer { found, known: of_program }) = refused else {
        panic!("{refused:?}");
    };
    assert_eq!((found, of_program), (next, known));
    let findings = doctor::findings(&hub.admin).await.unwrap();
    let schema = findings.iter().find(|finding| finding.check == "schema").unwrap();
    assert_eq!(schema.level, doctor::Level::Problem);
    assert_eq!(schema.text, format!("version {next} of {known}"));

    let altered = format!(
        "DELETE FROM hub.migration WHERE version = {next};
         UPDATE hub.migration SET sha256 = 'other' WHERE version = 2"
    );
    client.batch_execute(&altered).await.unwrap();
    let refused = migrate(&mut client).await;
    assert!(matches!(refused, Err(MigrationError::Altered { version: 2, .. })), "{refused:?}");
    assert_eq!(hub.count("hub.migration").await, i64::try_from(known).unwrap());
}

#[tokio::test]
async fn a_database_that_was_left_half_way_is_completed() {
    let hub = Hub::new().await;
    let half = "DROP TABLE hub.left_line CASCADE; DROP SCHEMA hub CASCADE; CREATE SCHEMA hub AUTHORIZATION rigd_hub;
                GRANT ALL ON SCHEMA hub TO rigd_hub";
    hub.admin.batch_execute(half).await.unwrap();
    let made = admin::init(&server().admin(&hub.database)).await.unwrap();
    assert_eq!(made, MIGRATIONS.len());
}

#[tokio::test]
async fn a_database_of_another_version_is_told_and_not_read() {
    let hub = Hub::new().await;
    let read = async || match Catalogue::new(server().admin(&hub.database)).rigs().await {
        Ok(_) => None,
        Err(CatalogueError::Version(VersionError::Other { found, advice, .. })) => {
            Some((found, advice))
        }
        Err(error) => panic!("{error:?}"),
    };
    assert_eq!(read().await, None);
    let known = MIGRATIONS.len();
    let (older, newer) =
        ("bring it up to date by `rigd-hub init`", "use the rigd-hub that made it, or a newer one");
    let add = format!("INSERT INTO hub.migration VALUES ({}, 'of the future', '')", known + 1);
    hub.admin.batch_execute(&add).await.unwrap();
    assert_eq!(read().await, Some((known + 1, newer)));
    let remove = format!("DELETE FROM hub.migration WHERE version >= {known}");
    hub.admin.batch_execute(&remove).await.unwrap();
    assert_eq!(read().await, Some((known - 1, older)));
    hub.admin.batch_execute("DROP TABLE hub.migration").await.unwrap();
    assert_eq!(read().await, Some((0, older)));
}
