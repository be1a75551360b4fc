begin().catch((error) => fail(`The replay cannot be shown: ${error.message}`));
