//! Tables in Markdown.

/// A table with rows printed as they come.
#[derive(Debug)]
pub struct Table(());

impl Table {
    /// Prints a title, and the heads of all columns but the first.
    pub fn new(title: &str, columns: &[&str]) -> Self {
        println!("\n{title}\n\n| | {} |\n|---{}|", columns.join(" | "), "|---".repeat(columns.len()));
        Self(())
    }

    /// Prints a row.
    pub fn row(&self, name: &str, cells: &[String]) {
        println!("| {name} | {} |", cells.join(" | "));
    }
}

/// A line below a table.
pub fn note(text: &str) {
    println!("{text}");
}

/// Rows of figures with a column of seeds each, in the order of the first seed. An unknown figure is NaN.
#[derive(Debug, Default)]
pub struct Rows(Vec<(String, Vec<Vec<f64>>)>);

impl Rows {
    /// Adds the figures of a seed to the row of a name.
    pub fn add(&mut self, name: impl Into<String>, figures: &[f64]) {
        let name = name.into();
        eprintln!("{name}: {figures:.4?}");
        match self.0.iter_mut().find(|(known, _)| *known == name) {
            Some((_, seeds)) => seeds.push(figures.to_vec()),
            None => self.0.push((name, vec![figures.to_vec()])),
        }
    }

    /// Names of the rows.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// A figure of all seeds.
    pub fn figure(&self, name: &str, column: usize) -> Option<Vec<f64>> {
        let (_, seeds) = self.0.iter().find(|(known, _)| known == name)?;
        Some(seeds.iter().map(|figures| figures[column]).collect())
    }

    /// Prints all rows, with `cell` formatting a figure of all seeds.
    pub fn print(&self, title: &str, columns: &[&str], cell: impl Fn(&[f64]) -> String) {
        let table = Table::new(title, columns);
        for (name, seeds) in &self.0 {
            let figure = |column: usize| seeds.iter().map(|figures| figures[column]).collect::<Vec<f64>>();
            let cells: Vec<String> = (0..columns.len()).map(|column| cell(&figure(column))).collect();
            table.row(name, &cells);
        }
    }
}

/// The mean of some numbers.
pub fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_add_to_the_row_of_their_name() {
        let mut rows = Rows::default();
        for seed in [1.0, 2.0] {
            rows.add("b", &[seed, 0.5]);
            rows.add("a", &[10.0 * seed, f64::NAN]);
        }
        assert_eq!(rows.names().collect::<Vec<_>>(), ["b", "a"]);
        assert_eq!(rows.figure("a", 0), Some(vec![10.0, 20.0]));
        assert_eq!(rows.figure("c", 0), None);
        assert_eq!(mean(&[1.0, 2.0]), 1.5);
    }
}
